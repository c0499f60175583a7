"""Every kernel and public function with valid arguments, and what its calls may do."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import numpy as np

import strand
import strand._core as _core

# what any call may raise
ALLOWED = (TypeError, ValueError, strand.StrandError, MemoryError)
# what else a call may raise of functions that are not public: Python itself makes the arguments' numbers
ALLOWED_PRIVATE = (IndexError, OverflowError)
# keep on for as many iterations as the caller asks for, unless they converge
ITERATIVE = ("icp", "icp_planes", "register_in_turn", "fit_tubes")
# attributes that are NaN where they are unknown
MAY_BE_NAN = ("confidence",)
# share of the calls that are made, where a call takes long
SHARES = {
    "reconstruct": 0.05,
    "reconstruct of all that is seen": 0.05,
    "find_ropes": 0.1,
    "register_views": 0.1,
}
# answers may hold NaN: it has a meaning, or Python checks the arguments before it calls the core
UNCHECKED = {
    "evaluate_spline",
    "interpolate",
    "tabulate_arc_length",
    "price_join",
    "measure_bending",
    "path_length",
    "end_direction",
    "straighten",
    "bridge",
    "unproject",
    "unproject inside a mask",
    "convolved",
    "measure_heights",
    "find_standing",
    "find_plane",
    "measure_plane_errors",
    "find_tabletop",
    "find_median",
    "find_values_near",
    "measure_linear_scatter",
    "fit.replace",
    "fit.radius",
    "images.price_reading",
    "images.measure_depth_gains",
    "images.measure_end_gains",
    "crop_points",
    "crop_images",
    "copy_constant",
    "measure_behind",
    "measure_depth_bends",
    "measure_variances",
}

RNG = np.random.default_rng(0)
TUBE = np.stack(
    [RNG.uniform(0, 0.3, 400), *(0.005 * f(RNG.uniform(0, np.pi, 400)) for f in (np.cos, np.sin))], axis=1
)
TUBE[:, 2] = np.sqrt(np.maximum(0.005**2 - np.clip(TUBE[:, 1], -0.005, 0.005) ** 2, 0.0)) + 0.5
NORMALS = np.stack([np.zeros(400), TUBE[:, 1] / 0.005, np.sqrt(1 - (TUBE[:, 1] / 0.005) ** 2)], axis=1)
NODES = np.stack([np.linspace(0, 0.3, 12), np.zeros(12), np.full(12, 0.5)], axis=1)
DEPTH = np.full((48, 64), 0.5)
MASK = np.zeros((48, 64), bool)
MASK[22:27, 4:60] = True
DEPTH[MASK] = 0.495
EYE = np.eye(4)
CAMERA = ((200.0, 200.0), (32.0, 24.0))
IMAGES = _core.RopeImages([DEPTH], [MASK], [CAMERA], [EYE], 0.005)
ROPE_MASK = _core.RopeMask(MASK)
SEEN = _core.Visibility([TUBE], [TUBE], [EYE])
FIT = strand.fit_tubes([TUBE], [[0.1, 0.0, 9.0]], [NODES], [EYE], 0.005, pose_sd=(0.01, 0.01), reference=0)
K = np.array([[200.0, 0, 32.0], [0, 200.0, 24.0], [0, 0, 1.0]])
CHAIN = strand.Chain(NODES, 0.005)
VIEW = strand.View(TUBE)
# depth of a rope on a table
ON_TABLE = np.repeat(np.repeat(np.where(MASK, 0.49, 0.5), 3, axis=0), 3, axis=1)
CLOUD = SimpleNamespace(**strand.msgs.make_point_cloud2(TUBE, "camera"))
CLOUD.fields = [SimpleNamespace(**field) for field in CLOUD.fields]

# function, positional arguments, keyword arguments
CALLS: dict[str, tuple[Callable, tuple, dict]] = {
    "radius_outlier_mask": (strand.radius_outlier_mask, (TUBE, 0.01, 3), {"nonfinite": "raise"}),
    "count_neighbors": (strand.count_neighbors, (TUBE, 0.01), {"nonfinite": "drop"}),
    "count_neighbors_each": (_core.count_neighbors_each, ([TUBE, TUBE], 0.01), {}),
    "normals_k": (strand.estimate_normals, (TUBE,), {"k": 8, "viewpoint": (0, 0, 9.0), "variation": True}),
    "normals_radius": (
        strand.estimate_normals,
        (TUBE,),
        {"radius": 0.01, "viewpoint": TUBE + 1.0, "nonfinite": "drop"},
    ),
    "estimate_normals_each": (_core.estimate_normals_each, ([TUBE, TUBE], 0.01), {}),
    "icp": (strand.icp, (TUBE, TUBE, 0.01), {"start": EYE, "max_iterations": 3, "tolerance": 1e-6}),
    "icp_planes": (strand.icp, (TUBE, TUBE, 0.01), {"target_normals": NORMALS, "max_iterations": 3}),
    "register_in_turn": (_core.register_in_turn, ([TUBE, TUBE], 0.01, 3, 1e-6), {}),
    "centerline": (strand.centerline, (TUBE, NORMALS, 0.005, 3), {}),
    "trace_chains": (strand.trace_chains, (TUBE, 0.005, 0.01), {"start": 3}),
    "trace_tubes": (strand.trace_tubes, (TUBE, (0.0, 0.0, 9.0), 0.005), {"min_nodes": 4}),
    "estimate_radii": (_core.estimate_radii, (TUBE, (0.0, 0.0, 9.0), 0.02, 20), {}),
    "fit_tubes": (
        strand.fit_tubes,
        ([TUBE], [[0.1, 0.0, 9.0]], [NODES], [EYE], 0.005),
        {
            "radius_classes": [0],
            "pose_sd": (0.01, 0.01),
            "reference": 0,
            "radius_prior": (0.005, 0.001),
            "band": (0.6, 0.4),
            "iterations": 2,
            "tolerance": 0.1,
            "min_bend": 1.5,
            "noise": 1e-4,
            "shared": (1.0, 1.0),
            "bounds": [[-1.0] * 3, [1.0] * 3],
        },
    ),
    "find_extents": (_core.find_extents, (FIT, [1e-3]), {}),
    "average_residuals": (_core.average_residuals, (FIT, 1.0), {}),
    "fit.replace": (FIT.replace, (), {"radii": np.array([0.005]), "curve": FIT.curve, "sigma": 1.0}),
    "fit.radius": (FIT.radius, (0,), {}),
    "EndObservation": (strand.EndObservation, (0, 0, (0.0, 0.0, 0.5), (1.0, 0.0, 0.0), 0.01), {}),
    "fit_spline": (_core.fit_spline, (NODES, 0.02, 0.01), {}),
    "evaluate_spline": (_core.evaluate_spline, (NODES, np.linspace(0, 9, 20)), {}),
    "interpolate": (_core.interpolate, (np.linspace(-1, 9, 20), np.arange(12.0), NODES), {}),
    "tabulate_arc_length": (_core.tabulate_arc_length, (NODES, 0.0, 9.0), {}),
    "find_parameters": (_core.find_parameters, (np.linspace(0, 1, 20), 0.0, 9.0, np.linspace(-1, 2, 9)), {}),
    "find_arc_lengths": (
        _core.find_arc_lengths,
        (np.linspace(0, 1, 20), 0.0, 9.0, np.linspace(-1, 10, 9)),
        {},
    ),
    "propagate_covariances": (
        _core.propagate_covariances,
        (np.ones((12, 4, 3, 3)), np.linspace(0, 9, 20)),
        {},
    ),
    "find_contacts": (_core.find_contacts, ([NODES, NODES + 0.01], 0.05, 0.1), {}),
    "find_overlaps": (
        _core.find_overlaps,
        (NODES, np.zeros(12, np.int64), np.linspace(0, 1, 12), 0.01, 0.05),
        {},
    ),
    "find_runs": (_core.find_runs, (MASK[24],), {}),
    "path_length": (_core.path_length, (NODES,), {}),
    "end_direction": (_core.end_direction, (NODES, 0.0, 0.05), {}),
    "bridge": (_core.bridge, (NODES, NODES + 0.5, 0.05, 0.01, (1.0, 1.0)), {}),
    "straighten": (_core.straighten, (NODES, 0.005, 0.02), {}),
    "measure_bending": (_core.measure_bending, (NODES,), {}),
    "price_join": (_core.price_join, ((0.0, 0, 0), (1.0, 0, 0), (1.0, 0, 0), (-1.0, 0, 0), 0.005), {}),
    "count_typical_neighbors": (_core.count_typical_neighbors, (TUBE, 0.01), {}),
    "count_seen": (_core.count_seen, (np.linspace(0, 1, 9), np.arange(9), np.linspace(0, 1, 5)), {}),
    "find_seen_ends": (
        _core.find_seen_ends,
        (np.linspace(0, 0.05, 99), np.ones(99), (0, 40, 99), (0.005, 0.02), 0.01, 3),
        {},
    ),
    "count_voxels": (_core.count_voxels, ([TUBE], 0.01), {}),
    "occludes": (_core.occludes, (TUBE, NODES, (0.0, 0.0, 0.0), 0.01), {}),
    "Visibility": (_core.Visibility, ([TUBE], [NODES], [EYE]), {}),
    "Visibility of an image": (_core.Visibility, ([(DEPTH, *CAMERA)], [NODES], [EYE]), {}),
    "visibility.states": (SEEN.states, (NODES, 0.005), {}),
    "visibility.free": (SEEN.free, (NODES, 0.005), {}),
    "visibility.seen_through": (SEEN.seen_through, (NODES, (1.0, 0.0, 0.0), 0.005), {}),
    "copy_depth": (_core.copy_depth, (DEPTH, 65.0), {}),
    "copy_depth in units": (_core.copy_depth, ((1e3 * DEPTH).astype(np.uint16), 65.0, 1e-3), {}),
    "find_centroids": (_core.find_centroids, ([TUBE, NODES],), {}),
    "measure_shift": (_core.measure_shift, ([TUBE], [EYE], [EYE]), {}),
    "unproject": (_core.unproject, (DEPTH, *CAMERA), {}),
    "unproject inside a mask": (_core.unproject, (DEPTH, *CAMERA, MASK), {}),
    "crop_points": (_core.crop_points, (TUBE, EYE, (-1.0,) * 3, (1.0,) * 3, TUBE), {}),
    "crop_images": (_core.crop_images, ([DEPTH], [CAMERA], [EYE], (-1.0,) * 3, (1.0,) * 3), {}),
    "convolved": (_core.convolved, (DEPTH.astype(np.float32), [0.5, 0.25]), {}),
    "measure_heights": (
        _core.measure_heights,
        (DEPTH, CAMERA, EYE, ((0.0, 0.0, -1.0), -0.5), ((-1.0,) * 3, (1.0,) * 3, EYE), 0.005),
        {},
    ),
    "find_standing": (
        _core.find_standing,
        (DEPTH, MASK, (-0.01, 0.02), [0.5, 0.25], 0.004, 0.3),
        {},
    ),
    "find_plane": (
        _core.find_plane,
        (TUBE, TUBE[:99], TUBE[:300], 0.01, (1e-9, 1e-3), 0.1, 2, 3, (3.0, 1e-3)),
        {},
    ),
    "count_disc_pairs": (_core.count_disc_pairs, (3.5,), {}),
    "find_median": (_core.find_median, (DEPTH,), {}),
    "find_values_near": (_core.find_values_near, (DEPTH, 0.5, 4), {}),
    "measure_linear_scatter": (
        _core.measure_linear_scatter,
        (np.ascontiguousarray(TUBE[:, :2]), np.ones(400), np.ones(400)),
        {},
    ),
    "measure_plane_errors": (_core.measure_plane_errors, (ON_TABLE, 0.5), {}),
    "find_tabletop": (_core.find_tabletop, (DEPTH, CAMERA, EYE, ((0.0, 0.0, -1.0), -0.5), 0.5), {}),
    "count_mask_parts": (_core.count_mask_parts, (MASK, 3.0, 1.0), {}),
    "number_blobs": (_core.number_blobs, (MASK,), {}),
    "find_strip_middles": (_core.find_strip_middles, (MASK, 1.5), {}),
    "measure_edge_distances": (_core.measure_edge_distances, (MASK, 40), {}),
    "find_short_outlines": (_core.find_short_outlines, (DEPTH.astype(np.float32) - 0.5, [1.0], 3), {}),
    "RopeMask": (_core.RopeMask, (MASK,), {}),
    "mask.estimate_radius": (ROPE_MASK.estimate_radius, (), {}),
    "trace_skeleton": (_core.trace_skeleton, (MASK,), {}),
    "mask.measure_strands": (ROPE_MASK.measure_strands, (5.0,), {}),
    "RopeImages": (_core.RopeImages, ([DEPTH], [MASK], [CAMERA], [EYE], 0.005), {}),
    "images.find_readings": (IMAGES.find_readings, (1, 2, [0]), {}),
    "images.price_reading": (IMAGES.price_reading, (0, [np.array([[4.0, 24.0], [60.0, 24.0]])]), {}),
    "images.fit": (
        IMAGES.fit,
        (
            [(0, [np.array([[4.0, 24.0], [60.0, 24.0]])])],
            ((0.0, 0.0, 1.0), 0.5),
            0,
            (0.01, 0.01),
            (None, 4.0, 0.5, 0.0),
            2,
            True,
        ),
        {},
    ),
    "images.measure_depth_gains": (
        IMAGES.measure_depth_gains,
        ([([NODES], [[0.0] * 6])], ((0.0, 0.0, 1.0), 0.5), 0.01),
        {},
    ),
    "images.measure_end_gains": (
        IMAGES.measure_end_gains,
        ([NODES], [NODES], [[0.0] * 6], ((0.0, 0.0, 1.0), 0.5), 0.01),
        {},
    ),
    "View": (strand.View, (TUBE, EYE), {"colors": np.abs(NORMALS)}),
    "View.from_depth": (strand.View.from_depth, (DEPTH, K, EYE), {"depth_scale": 1.0, "mask": MASK}),
    "estimate_radius": (
        lambda *points: strand.estimate_radius([strand.View(p) for p in points]),
        (TUBE,),
        {},
    ),
    "turntable_pose": (strand.turntable_pose, (0.3, 0.5, 0.4), {}),
    "pose_from_angles": (strand.pose_from_angles, ((0.1, 0.2, 0.3), (0.0, 0.0, 0.5)), {}),
    "rotation_xyz": (strand.rotation_xyz, ((0.1, 0.2, 0.3),), {}),
    "Chain": (strand.Chain, (NODES, 0.005), {"closed": False}),
    "chain.at": (CHAIN.at, (np.linspace(-0.01, 0.4, 20),), {}),
    "chain.nearest": (CHAIN.nearest, (NODES[3] + 0.01,), {}),
    "Model": (lambda *nodes: strand.Model([strand.Chain(n, 0.005) for n in nodes], [EYE]), (NODES,), {}),
    "View.crop": (VIEW.crop, (([-1.0] * 3, [1.0] * 3),), {}),
    "View.from_world": (strand.View.from_world, (TUBE, (0.0, 0.0, 9.0)), {"colors": np.abs(NORMALS)}),
    "measure_variances": (_core.measure_variances, (TUBE, NODES, 0.02, 5), {}),
    "find_nearest": (_core.find_nearest, (TUBE, NODES), {}),
    "find_squared_distances": (_core.find_squared_distances, (TUBE, NODES), {}),
    "measure_depth_bends": (_core.measure_depth_bends, ([DEPTH], [CAMERA], [TUBE], 3), {}),
    "measure_behind": (_core.measure_behind, (DEPTH, CAMERA, EYE, NODES, 0.1), {}),
    "copy_constant": (_core.copy_constant, (TUBE,), {}),
    "reconstruct": (
        lambda depth, *arguments, **more: strand.reconstruct(
            [strand.View.from_depth(depth, K)], *arguments, **more
        ),
        (DEPTH, 0.005, ([-1.0, -1.0, 0.4], [1.0, 1.0, 0.51]), 1),
        {"length": 0.14, "deadline": 5.0},
    ),
    "reconstruct of all that is seen": (
        lambda depth, intrinsics, **more: strand.reconstruct(
            [strand.View.from_depth(depth, intrinsics)], deadline=5.0, **more
        ),
        (ON_TABLE, K),
        {"radius": 0.005, "ropes": 1},
    ),
    "find_ropes": (
        lambda depth, *more: strand.find_ropes([strand.View.from_depth(depth, K)], *more).radius,
        (ON_TABLE, 0.005),
        {},
    ),
    "Box": (
        lambda points, *box: strand.View(points).crop(strand.Box(*box)),
        (TUBE, [-1.0] * 3, [1.0] * 3, EYE),
        {},
    ),
    "register_views": (
        lambda points, *more: strand.register_views([strand.View(points), strand.View(TUBE)], *more),
        (TUBE, 0.005, ([-1.0] * 3, [1.0] * 3)),
        {},
    ),
    "chain.tube": (CHAIN.tube, (16,), {}),
    "msgs.make_path": (
        lambda nodes, *more: strand.msgs.make_path(strand.Chain(nodes, 0.005), *more),
        (NODES, "world", 7),
        {},
    ),
    "msgs.make_marker_array": (
        lambda nodes, *more: strand.msgs.make_marker_array(
            strand.Model([strand.Chain(nodes, 0.005)], [EYE]), *more
        ),
        (NODES, "world", 7),
        {},
    ),
    "msgs.make_point_cloud2": (
        strand.msgs.make_point_cloud2,
        (TUBE, "world", 7),
        {"colors": np.abs(NORMALS)},
    ),
    "msgs.read_view": (strand.msgs.read_view, (CLOUD, None, EYE), {"depth_scale": 0.001}),
}


def list_numbers(value: object) -> list[np.ndarray]:
    """Return all arrays and numbers of an answer."""
    if isinstance(value, (np.ndarray, float, np.floating)):
        return [np.asarray(value)]
    if isinstance(value, (list, tuple)):
        return [each for part in value for each in list_numbers(part)]
    if isinstance(value, strand.Model):
        return list_numbers([value.poses, *value.chains])
    if isinstance(value, (strand.IcpResult, strand.TubeFit, strand.Chain, strand.View)):
        return [
            each
            for name in dir(value)
            if name[0] != "_" and name not in MAY_BE_NAN
            for each in list_numbers(getattr(value, name))
        ]
    return []


def list_allowed(name: str) -> tuple[type[Exception], ...]:
    """Return what a call may raise."""
    function = CALLS[name][0]
    owner, short = getattr(function, "__self__", None), function.__name__
    private = isinstance(owner, (_core.RopeImages, _core.RopeMask, _core.Visibility)) or (
        hasattr(_core, short) and not hasattr(strand, short)
    )
    return (*ALLOWED, *(ALLOWED_PRIVATE if private else ()))
