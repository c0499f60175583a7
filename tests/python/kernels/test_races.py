"""Arrays that another thread writes during a call: any answer or a ValueError, and the process lives."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import strand
from shared.kernel_calls import ARRAYS, call_kernel

RACE = """
import sys, threading, time
import numpy as np
sys.path[:0] = {path!r}
import strand
import strand._core as _core

points = np.random.default_rng(0).uniform(size=(4000, 3))
depth = np.full((60, 80), 1.0)
mask = np.zeros((60, 80), bool)
mask[28:33, 5:75] = True
shown = mask.view(np.uint8)
units = np.full((60, 80), 1000, np.uint16)
planes = np.zeros((3, 60, 80), np.float32)
planes[:, 28:33, 5:75] = 60.0
colors = np.zeros((60, 80, 3), np.uint8)
strips = dict(max_width=12.0, min_contrast=4.0, noise=7.0, aside=0.3, signed=False)
away = np.full((60, 80), 3.0, np.float32)
flat = depth.astype(np.float32)
number = np.zeros(4000, np.int64)
control = points[:20]
plan, lines = points.reshape(-1, 2)[:200], np.stack([np.arange(199), np.arange(1, 200)], axis=1)
eye, camera = np.eye(4), ((100.0, 100.0), (40.0, 30.0))
fit = dict(motions=[eye], radius=0.1, pose_sd=(0.01, 0.01), reference=None, iterations=2)
line = np.column_stack([np.linspace(0.0, 1.0, 40), np.zeros(40), np.zeros(40)])
tubes = _core.TubeQueries([line], [line[:, 0]], [0.1])
seen = [(depth, mask, None, camera, eye, 0.0, 0.0)]
tracked = [(line, line, line, line, (0.02, 0.03), None, [None, None], [])]
raced = [(*[points[:40]] * 4, (0.02, 0.03), None, [None, None], [])]
frame = dict(steps=3, bias_gain=0.1)
calls = {{
    "radius_outlier_mask": lambda: strand.radius_outlier_mask(points, 0.05, 3),
    "count_neighbors": lambda: strand.count_neighbors(points, 0.05),
    "normals by k": lambda: strand.estimate_normals(points, k=8, viewpoint=points),
    "normals by radius": lambda: strand.estimate_normals(points, radius=0.05, nonfinite="drop"),
    "icp": lambda: strand.icp(points, points, 0.05, target_normals=points, max_iterations=2),
    "centerline": lambda: strand.centerline(points, points, 0.05, 3),
    "trace_chains": lambda: strand.trace_chains(points, 0.02, 0.05),
    "trace_tubes": lambda: strand.trace_tubes(points[:500], points[:500], 0.05),
    "estimate_radii": lambda: _core.estimate_radii(points, (0.0, 0.0, -1.0), 0.1, 10),
    "count_typical_neighbors": lambda: _core.count_typical_neighbors(points, 0.05),
    "count_voxels": lambda: _core.count_voxels([points], 0.05),
    "find_nearest": lambda: _core.find_nearest(points, points),
    "find_squared_distances": lambda: _core.find_squared_distances(points, points),
    "crop_points": lambda: _core.crop_points(points, eye, (0.0,) * 3, (0.5,) * 3, points),
    "crop_images": lambda: _core.crop_images([depth], [camera], [eye], (-1.0,) * 3, (1.0,) * 3),
    "find_centroids": lambda: _core.find_centroids([points]),
    "measure_shift": lambda: _core.measure_shift([points], [eye], [eye]),
    "copy_constant": lambda: _core.copy_constant(points),
    "measure_variances": lambda: _core.measure_variances(points, points[:9], 0.2, 5),
    "measure_depth_bends": lambda: _core.measure_depth_bends([depth], [camera], [points], 1),
    "measure_behind": lambda: _core.measure_behind(depth, camera, eye, points, 0.1),
    "unproject": lambda: _core.unproject(depth, *camera),
    "copy_depth": lambda: _core.copy_depth(depth, 65.0),
    "copy_depth in units": lambda: _core.copy_depth(units, 65.0, 1e-3),
    "fit_tubes": lambda: strand.fit_tubes([points[:500]], np.ones((1, 3)), [control], **fit),
    "fit_spline": lambda: _core.fit_spline(points[:40], 0.5, 0.1),
    "evaluate_spline": lambda: _core.evaluate_spline(control, points[0]),
    "interpolate": lambda: _core.interpolate(points[0], points[:3, 0].copy(), points[:3]),
    "find_parameters": lambda: _core.find_parameters(points[:, 0].copy(), 0.0, 9.0, points[:, 1]),
    "find_arc_lengths": lambda: _core.find_arc_lengths(points[:, 0].copy(), 0.0, 9.0, points[:, 1]),
    "propagate_covariances": lambda: _core.propagate_covariances(
        points[:120].reshape(10, 4, 3, 3), points[:, 0]
    ),
    "find_contacts": lambda: _core.find_contacts([points[:40], points[40:80]], 0.3, 0.1),
    "find_overlaps": lambda: _core.find_overlaps(points[:99], number[:99], points[:99, 0].copy(), 0.1, 0.1),
    "find_crossed_segments": lambda: _core.find_crossed_segments(plan, lines),
    "find_crossed_segments, numbers": lambda: _core.find_crossed_segments(plan, number[:398].reshape(-1, 2)),
    "find_runs": lambda: _core.find_runs(mask[30]),
    "count_seen": lambda: _core.count_seen(points[:, 0].copy(), number, points[:, 1]),
    "find_seen_ends": lambda: _core.find_seen_ends(
        points[:, 0], points[:, 1], [0, 2000, 4000], (0.2, 0.6), 0.5, 3
    ),
    "path_length": lambda: _core.path_length(points),
    "bridge": lambda: _core.bridge(points[:9], points[9:18], 0.1, 0.1),
    "straighten": lambda: _core.straighten(points[:40], 0.1, 0.2),
    "visibility": lambda: _core.Visibility([points], [points], [eye]).states(points, 0.05),
    "visibility, image": lambda: _core.Visibility([(depth, *camera)], [points], [eye]).free(points, 0.1),
    "number_blobs": lambda: _core.number_blobs(mask),
    "find_strip_middles": lambda: _core.find_strip_middles(mask, 1.5),
    "measure_edge_distances": lambda: _core.measure_edge_distances(mask, 40),
    "count_mask_parts": lambda: _core.count_mask_parts(mask, 3.0, 1.0),
    "count_odd_pixels": lambda: _core.count_odd_pixels(mask),
    "select_beside": lambda: _core.select_beside(mask, depth, 40, 4, 1e4),
    "find_pieces_beside": lambda: _core.find_pieces_beside(mask, ~mask, 0.0, 1.0, (0.0, 1e9), 2),
    "estimate_radius": lambda: _core.RopeMask(mask).estimate_radius(),
    "trace_skeleton": lambda: _core.trace_skeleton(mask),
    "measure_strands": lambda: _core.RopeMask(mask).measure_strands(4.0),
    "convert_to_lab": lambda: _core.convert_to_lab(colors),
    "find_color_pieces": lambda: _core.find_color_pieces(planes, None, mask, **strips),
    "draw_ropes": lambda: _core.draw_ropes(planes, mask, away, [(1, (60.0, 60.0, 60.0))], 2.5),
    "convolved": lambda: _core.convolved(flat, [0.5, 0.25]),
    "measure_heights": lambda: _core.measure_heights(depth, camera, eye, ((0, 0, 1.0), 0.5), None, 0.1),
    "track_frame, images": lambda: _core.track_frame(seen, tracked, ((0, 0, -1.0), -1.0), 0.03, **frame),
    "track_frame": lambda: _core.track_frame(seen, raced, None, 0.03, **frame),
    "find_standing": lambda: _core.find_standing(depth, mask, (-0.1, 0.1), [0.5, 0.25], 0.01, 0.3),
    "find_plane": lambda: _core.find_plane(
        points, points[:99], points[:99], 0.1, (1e-9, 0.0), 0.1, 2, 3, (3.0, 0.1)
    ),
    "find_median": lambda: _core.find_median(points),
    "find_values_near": lambda: _core.find_values_near(depth, 0.5, 4),
    "measure_linear_scatter": lambda: _core.measure_linear_scatter(
        points[:, :2].copy(), points[:, 0].copy(), points[:, 2].copy()
    ),
    "measure_plane_errors": lambda: _core.measure_plane_errors(depth, 0.5),
    "find_tabletop": lambda: _core.find_tabletop(depth, camera, eye, ((0, 0, 1.0), 0.5), 0.5),
    "unproject, mask": lambda: _core.unproject(depth, *camera, mask),
    "find_short_outlines": lambda: _core.find_short_outlines(flat, [1.0], 3),
    "TubeQueries": lambda: _core.TubeQueries([points[:40]], [points[:40, 0]], [0.1]).signed_distances(points),
    "swept_spheres": lambda: tubes.swept_spheres(points[:99], points[99:198], points[:99, 0]),
    "ray_hits": lambda: tubes.ray_hits(points[:99], points[99:198]),
    "identify_knot": lambda: _core.identify_knot(points[:24], False),
    "draw_knot": lambda: _core.draw_knot(points[:24], False, (0.1, 0.2, 1.0)),
    "find_order_probability": lambda: _core.find_order_probability(
        points[:24], False, (0, 0, 1.0), points[:2], True
    ),
    "find_linking_number": lambda: _core.find_linking_number(points[:24], points[24:48], [True, True]),
    "RopeImages": lambda: _core.RopeImages([depth], [mask], [camera], [eye], 0.02).find_readings(1, 2, [0]),
}}
done = False


def write():
    values = (np.nan, 1e300, 0.0, -1e9, 1e-300, 0.5, 1e99, np.inf)
    while not done:
        for i, value in enumerate(values):
            points[i::7] = value
            depth[i::3] = value
            flat[i::3] = np.float32(min(value, 3e38))
            number[i::5] = -(2**62) + i
            shown[i::3] = 31 * i
            colors[i::3] = 31 * i
            planes[:, i::3] = np.float32(min(value, 3e38))
            away[i::3] = np.float32(min(value, 3e38))
        points[:] = np.random.random(points.shape)
        depth[:] = 1.0
        time.sleep(0)


sys.setswitchinterval(1e-5)
writer = threading.Thread(target=write)
writer.start()
answers = 0
try:
    for name, ask in calls.items():
        for _ in range({times}):
            try:
                ask()
                answers += 1
            except (ValueError, strand.NotEnoughDataError):
                pass
            except BaseException as error:
                raise SystemExit(f"{{name}}: {{type(error).__name__}}: {{error}}")
finally:
    done = True
    writer.join()
assert answers > 0
"""


def test_no_kernel_breaks_when_another_thread_writes_its_arrays():
    code = RACE.format(path=sys.path, times=12)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert not done.stderr


@pytest.mark.parametrize("kernel", ARRAYS)
def test_what_is_written_after_a_call_changes_no_answer(kernel):
    arrays = {name: np.array(array) for name, array in ARRAYS[kernel].items()}
    answer = call_kernel(kernel, **arrays)
    found = answer if isinstance(answer, (tuple, list)) else [answer]
    before = [np.copy(part) for part in found if isinstance(part, np.ndarray)]
    for array in arrays.values():
        array[...] = np.nan
    for part, kept in zip((part for part in found if isinstance(part, np.ndarray)), before, strict=True):
        np.testing.assert_array_equal(part, kept)


def test_nobody_can_write_to_the_arrays_of_a_fit():
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    angle = np.linspace(0.0, np.pi, 600)
    x = np.linspace(1.0, 4.0, 600)
    points = np.stack([x, np.cos(7.0 * angle), np.abs(np.sin(7.0 * angle))], axis=1)
    fit = strand.fit_tubes(
        [points], [[2.0, 0.0, 50.0]], [control], [np.eye(4)], 1.0, pose_sd=(0.01, 0.01), reference=0
    )
    extents = strand._core.find_extents(fit)
    kept = {name: np.array(getattr(fit, name)) for name in ("curve", "points", "inlier", "radii")}
    for changed in (fit, fit.replace(**kept), pickle.loads(pickle.dumps(fit))):
        for array in (changed.curve, changed.points, changed.inlier, changed.radii, changed.curves[0]):
            with pytest.raises(ValueError, match="WRITEABLE"):
                array.setflags(write=True)
        for array in kept.values():
            array[...] = 0
        assert strand._core.find_extents(changed) == extents
    with pytest.raises(ValueError, match="curve"):
        fit.replace(curve=np.full(600, 2**40))
    with pytest.raises(ValueError, match="radii"):
        strand._core.find_extents(fit.replace(radii=np.array([1e-300])))


def test_this_file_names_every_kernel_that_takes_arrays():
    stub = (Path(strand.__file__).parent / "_core.pyi").read_text()
    functions = {
        line.split("(")[0].removeprefix("def ") for line in stub.splitlines() if line.startswith("def ")
    }
    quick = {"set_num_threads", "num_threads", "count_cores", "find_extents"}
    quick |= {"average_residuals", "count_disc_pairs"}
    several = {"count_neighbors_each", "estimate_normals_each", "register_in_turn"}
    small = {"tabulate_arc_length", "end_direction", "measure_bending", "price_join", "occludes"}
    missing = {name for name in functions - quick - several - small if f"{name}(" not in RACE}
    assert not missing
