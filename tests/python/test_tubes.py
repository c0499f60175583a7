"""Tubes traced, fitted, registered, linked and measured."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import strand
from strand import linking, tubes
from strand._core import EndObservation, rope_extents
from strand.config import Linking
from strand.curve import Curve
from strand.outliers import without_outliers

SCENES = Path(__file__).resolve().parents[3] / "shared" / "scenes"
RADIUS = 0.0042


def tube(axis: np.ndarray, radius: float, noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Points all around a tube, evenly over its surface."""
    rng = np.random.default_rng(seed)
    chain = strand.Chain(axis, radius)
    s = rng.uniform(0, chain.length, int(chain.length / 5e-5))
    tangent = np.stack([np.interp(s, chain.arc_length, chain.tangents[:, k]) for k in range(3)], axis=1)
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = rng.uniform(0, 2 * np.pi, (len(s), 1))
    outward = np.cos(angle) * across + np.sin(angle) * np.cross(across, tangent)
    return chain.at(s) + (radius + rng.normal(scale=noise, size=(len(s), 1))) * outward


def seen(points: np.ndarray, axis: np.ndarray, camera: np.ndarray) -> np.ndarray:
    """The points whose outward normal faces a camera."""
    chain = strand.Chain(axis, RADIUS)
    feet = np.array([chain.at(chain.nearest(point)[0]) for point in points])
    return points[((points - feet) * (camera - points)).sum(axis=1) > 0]


@pytest.fixture(scope="module")
def paper():
    return strand.synthetic.scene("paper", seed=0)


def test_an_arc_follows_the_axis_of_a_bend_without_cutting_the_corner():
    angle = np.linspace(0, 1.5 * np.pi, 200)
    axis = 4 * RADIUS * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    camera = np.array([0.0, 0.0, 0.5])
    points = seen(tube(axis, RADIUS, 1e-4), axis, camera)
    ((nodes, support),) = strand.trace_tubes(points, camera, RADIUS)
    inner = nodes[4:-4]
    off = np.abs(np.linalg.norm(inner[:, :2], axis=1) - 4 * RADIUS)
    assert np.quantile(off, 0.9) < 0.03 * RADIUS
    assert off.max() < 0.15 * RADIUS
    assert np.abs(inner[:, 2]).max() < 0.05 * RADIUS
    assert len(nodes) == len(support)
    assert strand.Chain(nodes, RADIUS).length > 0.9 * strand.Chain(axis, RADIUS).length


def test_two_strands_in_contact_stay_two():
    y = RADIUS
    axes = [np.array([[-0.1, side * y, 0.0], [0.1, side * y, 0.0]]) for side in (-1.0, 1.0)]
    camera = np.array([0.0, 0.0, 0.5])
    points = np.concatenate(
        [seen(tube(axis, RADIUS, 1e-4, seed), axis, camera) for seed, axis in enumerate(axes)]
    )
    arcs = sorted((nodes for nodes, _ in strand.trace_tubes(points, camera, RADIUS)), key=lambda n: n[0, 1])
    assert len(arcs) == 2
    for nodes, side in zip(arcs, (-1.0, 1.0), strict=True):
        assert np.abs(nodes[:, 1] - side * y).max() < 0.1 * RADIUS
        assert np.ptp(nodes[:, 0]) > 0.18


def test_tracing_is_the_same_for_any_number_of_threads(paper):
    (view,) = without_outliers([paper.views[3].crop(paper.bounds)], RADIUS, strand.Config().filter)
    answers = []
    try:
        for threads in (1, 2, 3):
            strand.set_num_threads(threads)
            arcs = strand.trace_tubes(view.points, [0.0, 0.0, 0.0], RADIUS)
            answers.append([nodes.tobytes() for nodes, _ in arcs])
    finally:
        strand.set_num_threads(0)
    assert answers[0]
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"points": np.zeros((3, 2))}, ValueError, "points"),
        ({"points": np.zeros((3, 3), dtype=int)}, TypeError, "points"),
        ({"points": np.full((3, 3), np.nan)}, ValueError, "points"),
        ({"viewpoint": np.zeros((2, 3))}, ValueError, "viewpoint"),
        ({"viewpoint": np.zeros(2)}, ValueError, "viewpoint"),
        ({"radius": 0.0}, ValueError, "radius"),
        ({"radius": -1.0}, ValueError, "radius"),
        ({"min_nodes": -1}, ValueError, "min_nodes"),
    ],
)
def test_tracing_refuses_wrong_input_by_name(change, error, message):
    arguments = {"points": np.zeros((3, 3)), "viewpoint": np.ones(3), "radius": 0.01} | change
    with pytest.raises(error, match=message):
        strand.trace_tubes(**arguments)


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((500, 3)), np.full((20, 3), 0.1)])
def test_nothing_like_a_tube_gives_no_arc(points):
    assert strand.trace_tubes(points, [0.0, 0.0, 1.0], 0.01) == []


def test_half_shells_do_not_pull_into_each_other():
    """Opposite views of a straight tube whose poses are right: the known failure of point-to-point ICP."""
    axis = np.array([[-0.15, 0.0, 0.0], [0.15, 0.0, 0.0]])
    cameras = np.array([[0.0, -0.4, 0.1], [0.0, 0.4, 0.1]])
    views = [
        strand.View.from_world(seen(tube(axis, RADIUS, 3e-4, seed), axis, camera), camera)
        for seed, camera in enumerate(cameras)
    ]
    poses, sd = strand.register_views(views, RADIUS)
    turn, centre = poses[0][:3, :3], np.array([0.0, 0.0, 0.0])
    shift = turn @ (centre - views[0].viewpoint) + poses[0][:3, 3]
    assert np.abs(shift[1:]).max() < 1e-4
    # along the string there is only the prior: it stays within it, and says that it knows no more
    assert abs(shift[0]) < sd[0, 3]
    assert sd[0, 3] > 0.8 * strand.Config().poses.translation_sd
    assert sd[0, 4:].max() < 0.05 * sd[0, 3]
    icp = strand.icp(views[0].world_points, views[1].world_points, 2 * RADIUS)
    assert np.abs(icp.transformation[1:3, 3]).max() > 1e-3


def test_registration_finds_the_poses_and_says_how_well(paper):
    cropped = [view.crop(paper.bounds) for view in paper.views]
    views = without_outliers(cropped, RADIUS, strand.Config().filter)
    poses, sd = strand.register_views(views, RADIUS)
    nodes = paper.truth[0]
    for number, (given, found, true) in enumerate(zip(paper.poses, poses, paper.poses_true, strict=True)):
        off = {}
        for name, pose in (("given", given), ("found", found)):
            motion = pose @ np.linalg.inv(true)
            off[name] = np.sqrt(((nodes @ motion[:3, :3].T + motion[:3, 3] - nodes) ** 2).sum(axis=1).mean())
        if number == 3:
            np.testing.assert_allclose(found, given, atol=1e-12)
            assert (sd[number] == 0).all()
        else:
            assert off["found"] < 0.3e-3 < off["given"]
            assert (sd[number] > 0).all()
            assert sd[number][3:].max() < 0.3e-3


def test_what_the_data_leave_open_stays_as_reported_and_is_named():
    scene = strand.synthetic.scene("straight", seed=2)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    along = np.diff(scene.truth[0][[0, -1]], axis=0)[0]
    along /= np.linalg.norm(along)
    for given, found, sd in zip(scene.poses, model.poses, model.pose_sd, strict=True):
        moved = (found @ np.linalg.inv(given)) @ [*scene.truth[0].mean(axis=0), 1.0]
        assert abs((moved[:3] - scene.truth[0].mean(axis=0)) @ along) < 2e-3
        assert sd.max() < 1.01 * max(strand.Config().poses.rotation_sd, strand.Config().poses.translation_sd)
    assert any("leave a direction of its" in warning for warning in model.warnings)


def test_straight_strings_slide_less_than_their_poses_were_wrong():
    given, found, normalised = [], [], []
    for seed in range(5):
        scene = strand.synthetic.scene("straight", seed=seed)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, keep_stages=True)
        nodes = scene.truth[0]
        along = (nodes[-1] - nodes[0]) / np.linalg.norm(nodes[-1] - nodes[0])
        for number, covariance in enumerate(model.stages["fit"].pose_covariance):
            slides = []
            for pose in (scene.poses[number], model.poses[number]):
                motion = pose @ np.linalg.inv(scene.poses_true[number])
                slides.append(along @ (nodes @ motion[:3, :3].T + motion[:3, 3] - nodes).mean(axis=0))
            if number != 3:
                given.append(slides[0])
                found.append(slides[1])
                normalised.append(slides[1] / np.sqrt(along @ covariance[3:, 3:] @ along))
    assert np.sqrt(np.mean(np.square(found))) < 0.7 * np.sqrt(np.mean(np.square(given)))
    assert 0.6 < np.sqrt(np.mean(np.square(normalised))) < 1.6


def test_ends_are_as_uncertain_as_they_say():
    normalised = []
    for name in ("s", "arc", "straight"):
        for seed in range(3):
            scene = strand.synthetic.scene(name, seed=seed)
            (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
            for node, covariance, outward in (
                (chain.points[0], chain.covariance[0], -chain.tangents[0]),
                (chain.points[-1], chain.covariance[-1], chain.tangents[-1]),
            ):
                true = min(scene.truth[0][[0, -1]], key=lambda end: np.linalg.norm(end - node))
                normalised.append(outward @ (node - true) / np.sqrt(outward @ covariance @ outward))
    assert 0.4 < np.sqrt(np.mean(np.square(normalised))) < 2.0


@pytest.mark.parametrize("radius", [0.003, 0.0042, 0.006, 0.010])
def test_the_radius_is_found_from_the_data(radius):
    scene = strand.synthetic.scene("s", seed=4, radius=radius)
    model = strand.reconstruct(scene.views, bounds=scene.bounds)
    assert model.chains[0].radius == pytest.approx(radius, rel=0.02)
    assert len(model.chains) == 1


@pytest.mark.parametrize("name", ["coil_mid", "overhand_mid", "paper_mid", "heap00", "hard03", "two_ropes"])
def test_touching_strands_and_knots_come_out_whole(name):
    scene = strand.load_scene(SCENES / f"{name}.npz")
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == len(scene.truth)
    for chain in model.chains:
        truth = min(
            scene.truth, key=lambda t: strand.Chain(t, 0.01).nearest(chain.points[len(chain.points) // 2])[1]
        )
        line = strand.Chain(truth, scene.radius)
        s, distance = np.array([line.nearest(point) for point in chain.points]).T
        assert np.sqrt((distance**2).mean()) < 0.2e-3
        assert (np.diff(s) > -1e-3).all() or (np.diff(s) < 1e-3).all(), "in order along the true string"
        assert chain.length == pytest.approx(line.length, rel=0.006)


def test_a_chain_says_what_it_knows(paper, tmp_path):
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds)
    (chain,) = model.chains
    count = len(chain.points)
    assert chain.covariance.shape == (count, 3, 3)
    assert (np.linalg.eigvalsh(chain.covariance) > 0).all()
    assert chain.points_seen.shape == chain.views_seen.shape == (count,)
    assert (chain.views_seen <= 7).all()
    assert np.median(chain.views_seen) >= 5
    np.testing.assert_allclose(chain.at(chain.arc_length), chain.points, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(chain.tangents, axis=1), 1.0, atol=1e-12)
    for s in np.linspace(0.01, chain.length - 0.01, 7):
        found, distance = chain.nearest(chain.at(s))
        assert found == pytest.approx(s, abs=1e-6)
        assert distance < 1e-9
    model.save(tmp_path / "model.json")
    loaded = strand.load(tmp_path / "model.json")
    np.testing.assert_array_equal(loaded.chains[0].covariance, chain.covariance)
    np.testing.assert_array_equal(loaded.chains[0].views_seen, chain.views_seen)
    np.testing.assert_array_equal(loaded.chains[0].at(0.1), chain.at(0.1))
    np.testing.assert_array_equal(loaded.pose_sd, model.pose_sd)


def test_reported_deviations_are_about_right():
    values = []
    for seed in range(6):
        scene = strand.synthetic.scene("s", seed=seed)
        (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
        line = strand.Chain(scene.truth[0], scene.radius)
        for point, covariance in zip(chain.points[8:-8:4], chain.covariance[8:-8:4], strict=True):
            s, _ = line.nearest(point)
            _, _, axes = np.linalg.svd(np.atleast_2d(line.at(s + 1e-4) - line.at(s - 1e-4)))
            across = axes[1:]
            error = across @ (point - line.at(s))
            values.append(error @ np.linalg.solve(across @ covariance @ across.T, error) / 2)
    assert 0.5 < np.mean(values) < 2.0


def test_a_curve_knows_its_arc_length_and_curvature():
    angle = np.linspace(0, 2 * np.pi, 41)
    control = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    curve = Curve.whole(control).part(0.02, 0.12)
    assert curve.length == pytest.approx(0.1, rel=1e-6)
    position, tangent, bend = curve.at(curve.nodes(0.005))
    radius = np.linalg.norm(position, axis=1)
    np.testing.assert_allclose(np.linalg.norm(bend, axis=1), 1 / radius, rtol=3e-3)
    np.testing.assert_allclose((tangent * bend).sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(
        curve.arc_length(curve.parameter([0.0, 0.05, 0.1])), [0.0, 0.05, 0.1], atol=1e-9
    )
    with pytest.raises(ValueError, match="start, stop"):
        Curve(control, 3.0, 2.0)
    with pytest.raises(ValueError, match="control: expected at least four"):
        Curve(control[:3], 0.0, 0.5)


def test_linking_prefers_the_straight_way_on():
    up = np.array([0.0, 0.0, 2 * RADIUS])
    line = np.linspace(-0.06, 0.06, 60)
    lower = np.stack([line, 0 * line, 0 * line], axis=1)
    upper = np.stack([0 * line, line, 0 * line], axis=1) + up
    arcs = [lower[:25], lower[36:], upper]
    chains = linking.link(arcs, RADIUS, Linking())
    assert sorted(round(float(np.ptp(nodes[:, 0])), 3) for nodes, _ in chains) == [0.0, 0.12]
    assert not any(closed for _, closed in chains)
    far = [lower[:10], lower[50:]]
    assert len(linking.link(far, RADIUS, Linking())) == 2


def test_an_arc_that_another_runs_into_is_parted_there():
    line = np.linspace(-0.05, 0.05, 60)
    through = np.stack([line, 0 * line, 0 * line], axis=1)
    into = np.stack([0 * line, np.linspace(0.5 * RADIUS, 0.08, 60), 0 * line], axis=1)
    assert [len(part) > 3 for part in linking.part_at_contacts([through, into], RADIUS, Linking())] == [
        True
    ] * 3
    clear = into + np.array([0.0, 2 * RADIUS, 0.0])
    assert len(linking.part_at_contacts([through, clear], RADIUS, Linking())) == 2


def test_a_fit_that_the_data_cannot_support_is_refused():
    clouds = tubes.Clouds([np.random.default_rng(0).uniform(size=(50, 3))], np.zeros((1, 3)), 0, None)
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1) + 5.0
    fit = partial(
        strand.fit_tubes,
        clouds.points,
        clouds.viewpoints,
        [control],
        np.eye(4)[None],
        0.01,
        pose_sd=(0.01, 0.01),
    )
    with pytest.raises(strand.NotEnoughDataError, match="points"):
        fit(reference=None)
    with pytest.raises(ValueError, match="reference"):
        fit(reference=3)


def test_methods_and_numbers_are_kept_apart(paper):
    config = dataclasses.replace(strand.Config(), tubes=strand.config.Tubes(node_spacing=1.0))
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, config=config)
    assert len(model.chains[0].points) == pytest.approx(model.chains[0].length / paper.radius, rel=0.02)


def test_a_radius_from_one_view_comes_with_a_warning(paper):
    model = strand.reconstruct([paper.views[3]], bounds=paper.bounds)
    assert any(warning.startswith("radius: one view alone") for warning in model.warnings)
    given = strand.reconstruct([paper.views[3]], paper.radius, paper.bounds)
    assert not any(warning.startswith("radius") for warning in given.warnings)


@pytest.mark.parametrize("bend", [0.03, 0.06])
@pytest.mark.parametrize("method", ["tubes", "published"])
def test_a_ring_closes(bend, method):
    angle = np.linspace(0, 2 * np.pi, 300)
    ring = np.stack([bend * np.cos(angle), bend * np.sin(angle), np.full(300, RADIUS)], axis=1)
    cameras = 0.4 * np.array([[0.0, -0.8, 0.8], [0.8, 0.0, 0.8], [0.0, 0.8, 0.8], [-0.8, 0.0, 0.8]])
    views = [
        strand.View.from_world(seen(tube(ring, RADIUS, 2e-4, seed), ring, camera), camera)
        for seed, camera in enumerate(cameras)
    ]
    model = strand.reconstruct(views, RADIUS, config=strand.Config(method=method))
    (chain,) = model.chains
    assert chain.closed
    assert chain.length == pytest.approx(2 * np.pi * bend, rel=0.01)
    assert np.abs(np.linalg.norm(chain.points[:, :2], axis=1) - bend).max() < 0.2 * RADIUS
    steps = np.linalg.norm(np.diff(np.vstack([chain.points, chain.points[:1]]), axis=0), axis=1)
    assert steps.max() < 2.5 * np.median(steps)


def test_a_wrong_radius_is_named(paper):
    half = strand.reconstruct(paper.views, 0.5 * paper.radius, paper.bounds)
    assert any("is the radius right" in warning for warning in half.warnings)
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds)
    assert not any("is the radius right" in warning for warning in model.warnings)


def test_numbers_that_would_fill_the_memory_are_refused(paper):
    with pytest.raises(ValueError, match=r"Tubes\.spacing: expected at least"):
        strand.config.Tubes(spacing=1e-6)
    with pytest.raises(ValueError, match=r"Tubes\.node_spacing: expected at least"):
        strand.config.Tubes(node_spacing=1e-12)
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    with pytest.raises(ValueError, match="radius"):
        strand.fit_tubes(
            [np.zeros((5, 3))],
            np.ones((1, 3)),
            [control],
            np.eye(4)[None],
            1e-300,
            pose_sd=(0.1, 0.1),
            reference=None,
        )


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"reference": -1}, ValueError, "reference"),
        ({"iterations": -1}, ValueError, "iterations"),
        ({"pose_sd": (1.0,)}, ValueError, "pose_sd"),
        ({"band": (1.0,)}, ValueError, "band"),
        ({"radius_classes": [1]}, ValueError, "radius_classes"),
        ({"radius_classes": [0, 0]}, ValueError, "radius_classes"),
        ({"radius_classes": [0.0]}, TypeError, "radius_classes"),
        ({"radius_prior": (0.1, 0.0)}, ValueError, "radius_prior"),
        ({"radius_prior": [0.1]}, ValueError, "radius_prior"),
        ({"min_bend": 0.0}, ValueError, "min_bend"),
        ({"noise": -1.0}, ValueError, "noise"),
        ({"bounds": ([1.0] * 3, [0.0] * 3)}, ValueError, "bounds"),
    ],
)
def test_a_fit_refuses_wrong_input_by_name(change, error, message):
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    arguments = {"pose_sd": (0.1, 0.1), "reference": None} | change
    with pytest.raises(error, match=message):
        strand.fit_tubes([np.zeros((5, 3))], np.ones((1, 3)), [control], np.eye(4)[None], 0.1, **arguments)


def test_registration_refuses_what_are_no_views(paper):
    with pytest.raises(TypeError, match=r"views\[0\]"):
        strand.register_views([5], RADIUS)
    with pytest.raises(ValueError, match="views"):
        strand.register_views([], RADIUS)
    with pytest.raises(ValueError, match="radius"):
        strand.register_views(paper.views, -1.0)
    with pytest.raises(TypeError, match="config"):
        strand.register_views(paper.views, RADIUS, config=5)


def test_a_loop_that_the_points_show_is_not_stiffened_until_it_is_straight():
    """Noise makes it bend more tightly in places than strings are said to."""
    r, turn = 0.0056, 2.6 * np.pi
    angle = np.interp(np.linspace(0.0, 1.0, 400), [0.0, 0.25, 0.75, 1.0], [0.0, 0.0, turn, turn])
    steps = np.stack([np.cos(angle), np.sin(angle), np.full(400, 0.03)], axis=1)
    nodes = np.cumsum(steps, axis=0) * 0.5 / 400
    nodes -= nodes.mean(axis=0) * [1.0, 1.0, 0.0] - [0.0, 0.0, r]
    scene = strand.synthetic.scene(chains=[nodes], radius=r, noise=0.0013, views=3, seed=0)
    views = [view.crop(scene.bounds) for view in scene.views]
    start = strand._core.spline_through(scene.truth[0][::3], 2.5 * r, 2.0 * r)
    fit = strand.fit_tubes(
        [view.world_points for view in views],
        [view.viewpoint for view in views],
        [start],
        [np.eye(4)] * 3,
        r,
        reference=1,
        pose_sd=(0.009, 0.0015),
        along_ray=True,
        iterations=60,
        min_bend=5.0,
    )
    assert Curve.whole(fit.curves[0]).length == pytest.approx(Curve.whole(start).length, rel=0.01)
    assert fit.inlier.mean() > 0.9


def straight_fit(**changes):
    """A fit to one view of a straight tube."""
    along, angle = np.meshgrid(np.linspace(0.0, 0.2, 120), np.linspace(0.1, np.pi - 0.1, 20))
    points = np.stack([along, 0.004 * np.cos(angle), 0.004 * np.sin(angle)], axis=-1).reshape(-1, 3)
    nodes = np.stack([np.linspace(0.0, 0.2, 50), np.zeros(50), np.zeros(50)], axis=1)
    arguments = {
        "points": [points],
        "viewpoints": [[0.1, 0.0, 1.0]],
        "curves": [strand._core.spline_through(nodes, 0.01, 0.0)],
        "motions": [np.eye(4)],
        "radius": 0.004,
        "pose_sd": (0.01, 0.002),
        "reference": None,
    }
    return strand.fit_tubes(**arguments | changes)


def test_a_fit_can_be_pickled_and_changed():
    fit = straight_fit()
    again = pickle.loads(pickle.dumps(fit))
    names = inspect.signature(strand.TubeFit).parameters
    assert len(names) == 19
    for name in names:
        np.testing.assert_array_equal(getattr(again, name), getattr(fit, name))
    assert (fit.radius(0), fit.band(0)) == (fit.radii[0], fit.bands[0])
    np.testing.assert_array_equal(fit.pose_sd, np.sqrt(fit.pose_covariance.diagonal(axis1=1, axis2=2)))
    wider = fit.replace(radii=np.array([0.005]))
    assert (wider.radius(0), fit.radius(0)) == (0.005, 0.004)
    assert wider.points is fit.points
    assert len(repr(fit).splitlines()) == 1
    with pytest.raises(IndexError, match="curve 1"):
        fit.radius(1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius_classes": np.array([1])}, "radius_classes: expected the number of one of 1 radii"),
        ({"radii": np.zeros(0)}, "radius_classes"),
        ({"bands": np.zeros(2)}, "bands: expected one for each of 1 radii"),
        ({"view": np.zeros(3, dtype=np.int64)}, "view: expected one row for each of the 2400 points, got 3"),
        ({"points": np.zeros((2400, 2))}, r"points: expected shape \(2400, 3\), got \(2400, 2\)"),
        ({"curve": np.full(2400, 1)}, "curve: expected the number of one of 1 curves"),
        ({"pose_covariance": np.zeros((1, 3, 3))}, r"pose_covariance: expected shape \(V, 6, 6\)"),
    ],
)
def test_a_fit_whose_arrays_do_not_belong_together_is_refused(change, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        straight_fit().replace(**change)


def test_defaults_of_a_fit_are_what_its_signature_says():
    parameters = inspect.signature(strand.fit_tubes).parameters.values()
    said = {one.name: one.default for one in parameters if one.default is not one.empty}
    assert said["iterations"] == 12
    bent = {"min_bend": 30.0, "along_ray": True}
    for change in ({}, bent):
        fit, same = straight_fit(**change), straight_fit(**said | change)
        for name in ("curves", "bands", "residual", "pose_covariance", "covariances"):
            np.testing.assert_array_equal(getattr(fit, name), getattr(same, name))


def test_numbers_of_a_fit_may_be_whole():
    box = {"bounds": ([-1, -1, -1], [1, 1, 1])}
    whole = straight_fit(viewpoints=[[0, 0, 1]], motions=[np.eye(4, dtype=int)], min_bend=2, **box)
    box = {"bounds": ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0])}
    same = straight_fit(viewpoints=[[0.0, 0.0, 1.0]], min_bend=2.0, **box)
    np.testing.assert_array_equal(whole.curves[0], same.curves[0])


def test_an_end_observation_can_be_pickled():
    seen = EndObservation(1, 2, [0, 0, 1], np.array([0.0, 1.0, 0.0]), 1e-3)
    again = pickle.loads(pickle.dumps(seen))
    assert (again.view, again.end, again.sd) == (1, 2, 1e-3)
    assert again.place.tolist() == [0.0, 0.0, 1.0]
    assert again.outward.tolist() == [0.0, 1.0, 0.0]
    assert repr(again) == repr(seen)


def test_extents_need_a_tolerance_for_each_curve():
    fit = straight_fit()
    ((start, stop),) = rope_extents(fit)
    assert 0.0 <= start < stop <= len(fit.curves[0]) - 3
    assert rope_extents(fit, [1e-3]) == [pytest.approx((start, stop), abs=0.2)]
    with pytest.raises(ValueError, match="surface_tolerance: expected one for each of 1 curves, got 2"):
        rope_extents(fit, [1e-3, 1e-3])


def fewer(fit, left_out):
    """A fit without its first points."""
    each = [
        "points",
        "to_camera",
        "view",
        "curve",
        "parameter",
        "residual",
        "facing",
        "weight",
        "explained",
        "inlier",
    ]
    return fit.replace(**{name: getattr(fit, name)[left_out:] for name in each})


def test_a_fit_goes_on_from_an_earlier_one():
    scene = strand.synthetic.scene("s", seed=3)
    views = [view.crop(scene.bounds) for view in scene.views]
    start = strand._core.spline_through(scene.truth[0], 1.5 * RADIUS, 2.0 * RADIUS)
    fit = partial(
        strand.fit_tubes,
        [view.world_points for view in views],
        [view.viewpoint for view in views],
        radius=RADIUS,
        reference=3,
        pose_sd=(0.009, 0.0015),
        along_ray=True,
        iterations=30,
    )
    first = fit([start], [np.eye(4)] * len(views), uncertainty=False)
    again = fit(first.curves, first.motions, previous=first)
    anew = fit(first.curves, first.motions)
    # what another search for the points' places changes is far below the curve's standard deviation
    sd = np.sqrt(np.trace(again.covariances[0][:, 0], axis1=1, axis2=2)).mean()
    assert np.abs(again.curves[0] - anew.curves[0])[3:-3].max() < sd
    assert (again.inlier == anew.inlier).mean() > 0.999
    # no more steps than allowed, however far it is from its end
    once = fit(first.curves, first.motions, previous=first, iterations=1, tolerance=1e-300)
    assert np.abs(once.curves[0] - again.curves[0])[3:-3].max() < sd
    lost = ~np.isfinite(first.residual)
    assert not np.isfinite(again.residual[lost]).any()
    with pytest.raises(ValueError, match="previous"):
        fit([start], first.motions, previous=fewer(first, 1))
    with pytest.raises(ValueError, match="previous"):
        fit([start[:4]], first.motions, previous=first)
