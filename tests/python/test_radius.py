"""Radii from the data: of one rope, of several, from one view, and what is said of them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import strand
from strand import tubes
from strand._core import fit_tubes
from strand.config import Filter
from strand.outliers import without_outliers
from strand.radius import Radii, agreeing
from strand.synthetic import camera_pose, render_depth, sense

SCENES = Path(__file__).resolve().parents[3] / "shared" / "scenes"
CAMERA = np.array([0.0, 0.0, 0.4])


def strip(radius: float, depth_noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """The upper half of a straight tube, evenly over the image of a camera above it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.1, 0.1, 4000), rng.uniform(-radius, radius, 4000)
    z = np.sqrt(radius**2 - y**2)
    points = np.stack([x, y, z], axis=1)
    ray = points - CAMERA
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return points + rng.normal(scale=depth_noise, size=(4000, 1)) * ray


def crossing(thin: float, thick: float, seed: int = 0, size: tuple[int, int] = (640, 480), count: int = 5):
    """Two ropes, the second over the first: views, extraction range and true axes."""
    t = np.linspace(-0.5, 0.5, 400)
    under = np.stack([0.3 * t, 0.03 * np.sin(5 * t), thin + 0 * t], axis=1)
    over = np.stack([0.03 * np.sin(4 * t), 0.24 * t, 0 * t], axis=1)
    over[:, 2] = thick + (2 * thin + 5e-4) * np.exp(-((over[:, 1] / 0.04) ** 2))
    width, height = size
    focal = 430.0 / 640.0 * width
    intrinsics = np.array(
        [[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
    )
    rng = np.random.default_rng(seed)
    views = []
    for azimuth in np.linspace(-0.5 * np.pi, 0.5 * np.pi, count):
        pose = camera_pose(azimuth, 0.38)
        depth = render_depth([under, over], [thin, thick], intrinsics, pose, size)
        image = sense(depth, noise=7e-4, flying=0.05, step=thin, depth_scale=1e-4, rng=rng)
        views.append(strand.View.from_depth(image * 1e-4, intrinsics, pose))
    nodes = np.concatenate([under, over])
    low, high = nodes.min(axis=0) - 0.02, nodes.max(axis=0) + 0.02
    low[2] = 0.6 * thin
    return views, (low, high), (under, over)


@pytest.mark.parametrize("depth_noise", [0.0, 1e-3, 3e-3])
@pytest.mark.parametrize("radius", [0.002, 0.005, 0.01])
def test_a_strip_gives_its_radius_whatever_the_noise_in_depth(radius, depth_noise):
    view = strand.View.from_world(strip(radius, depth_noise), CAMERA)
    radii, sd = strand.estimate_radius([view])
    assert radii[0] == pytest.approx(radius, rel=0.06)
    assert np.abs(radii[0] - radius) < 2 * sd[0]
    assert 0.05 * radius <= sd[0] < 0.2 * radius


def test_the_estimate_moves_with_the_data_and_scales_with_it():
    points = strip(0.004)
    (radius,), _ = strand.estimate_radius([strand.View.from_world(points, CAMERA)])
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = strand.View.from_world(points @ turn.T + [1.0, 2.0, 3.0], turn @ CAMERA + [1.0, 2.0, 3.0])
    assert strand.estimate_radius([moved])[0][0] == pytest.approx(radius, rel=0.02)
    twice = strand.View.from_world(2 * points, 2 * CAMERA)
    assert strand.estimate_radius([twice])[0][0] == pytest.approx(2 * radius, rel=0.02)
    shuffled = strand.View.from_world(np.random.default_rng(1).permutation(points), CAMERA)
    assert strand.estimate_radius([shuffled])[0][0] == pytest.approx(radius, rel=0.02)


def test_the_estimate_is_the_same_for_any_number_of_threads():
    view = strand.View.from_world(strip(0.004, 1e-3), CAMERA)
    answers = []
    try:
        for threads in (1, 2, 3):
            strand.set_num_threads(threads)
            answers.append(strand.estimate_radius([view])[0].tobytes())
    finally:
        strand.set_num_threads(0)
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize(
    ("views", "error", "message"),
    [
        ([], ValueError, "views"),
        ([5], TypeError, r"views\[0\]"),
        ([strand.View(np.zeros((0, 3)))], strand.NotEnoughDataError, "views"),
        ([strand.View(np.random.default_rng(0).normal(size=(500, 3)))], strand.NotEnoughDataError, "views"),
    ],
)
def test_what_has_no_radius_is_refused(views, error, message):
    with pytest.raises(error, match=message):
        strand.estimate_radius(views)


@pytest.mark.parametrize(
    ("name", "limit"), [("s_low", 0.01), ("coil_mid", 0.01), ("hard03", 0.02), ("s_high", 0.03)]
)
def test_a_reconstruction_finds_the_radius(name, limit):
    scene = strand.load_scene(SCENES / f"{name}.npz")
    model = strand.reconstruct(scene.views, None, scene.bounds)
    (chain,) = model.chains
    assert chain.radius == pytest.approx(scene.radius, rel=limit)
    assert 0 < chain.radius_sd < limit * scene.radius


@pytest.mark.parametrize("radius", [0.002, 0.006, 0.010])
def test_thin_and_thick_ropes(radius):
    scene = strand.synthetic.scene("s", seed=5, radius=radius)
    model = strand.reconstruct(scene.views, None, scene.bounds)
    assert model.chains[0].radius == pytest.approx(radius, rel=0.02)


@pytest.mark.parametrize(("thin", "thick"), [(0.003, 0.006), (0.004, 0.005)])
def test_ropes_that_differ_have_a_radius_each(thin, thick):
    views, bounds, _ = crossing(thin, thick)
    model = strand.reconstruct(views, None, bounds)
    assert len(model.chains) == 2
    by_length = [chain.radius for chain in model.chains]
    assert by_length == pytest.approx([thin, thick], rel=0.03)
    assert all(0 < chain.radius_sd < 0.03 * chain.radius for chain in model.chains)


@pytest.mark.parametrize(("crossings", "views", "seed"), [(7, 7, 32006), (10, 3, 32045)])
def test_a_radius_is_as_sure_as_it_is_right_in_a_tangle(crossings, views, seed):
    chains = strand.synthetic.tangle(crossings, 3, seed=seed)
    scene = strand.synthetic.scene(chains=chains, seed=seed, views=views)
    for radius in (None, scene.radius):
        model = strand.reconstruct(scene.views, radius, scene.bounds)
        for chain in model.chains:
            assert abs(chain.radius - scene.radius) < 2.5 * chain.radius_sd


def test_ropes_that_do_not_differ_share_one_radius():
    views, bounds, _ = crossing(0.004, 0.004)
    model = strand.reconstruct(views, None, bounds)
    assert len(model.chains) == 2
    assert model.chains[0].radius == model.chains[1].radius == pytest.approx(0.004, rel=0.02)


def test_radii_that_are_known_are_kept_and_told_apart():
    views, bounds, truth = crossing(0.003, 0.006)
    model = strand.reconstruct(views, [0.006, 0.003], bounds)
    assert [chain.radius for chain in model.chains] == pytest.approx([0.003, 0.006], rel=0.01)
    assert all(0 < chain.radius_sd <= 0.003 * chain.radius for chain in model.chains)
    for chain, axis in zip(model.chains, truth, strict=True):
        off = [strand.Chain(axis, chain.radius).nearest(point)[1] for point in chain.points[2:-2]]
        assert np.sqrt(np.mean(np.square(off))) < 3e-4


@pytest.mark.parametrize("radius", [(0.003, 0.006), None])
def test_ropes_of_two_kinds_are_decided_again_where_points_are_left_over(monkeypatch, radius):
    views, bounds, truth = crossing(0.003, 0.006)
    compared = tubes.compared
    decisions = []

    def cut_short_at_first(*arguments):
        ways = compared(*arguments)
        if not decisions:
            for rope, (best, *_) in enumerate(ways):
                chains = [(nodes[: len(nodes) // 2], ring) for nodes, ring in best.assembly.chains]
                ways[rope] = [replace(best, assembly=replace(best.assembly, chains=chains))]
        decisions.append(ways)
        return ways

    monkeypatch.setattr(tubes, "compared", cut_short_at_first)
    model = strand.reconstruct(views, radius, bounds)
    assert len(decisions) == 2
    assert [chain.radius for chain in model.chains] == pytest.approx([0.003, 0.006], rel=0.03)
    lengths = [strand.Chain(axis, 1.0).length for axis in truth]
    assert [chain.length for chain in model.chains] == pytest.approx(lengths, rel=0.02)


def test_one_view_says_how_little_it_knows():
    scene = strand.load_scene(SCENES / "s_mid.npz")
    model = strand.reconstruct([scene.views[3]], None, scene.bounds)
    chain = model.chains[0]
    assert abs(chain.radius - scene.radius) < 2 * chain.radius_sd < 0.6 * scene.radius
    assert any(warning.startswith("radius: one view alone") for warning in model.warnings)


def test_one_view_of_two_kinds_of_rope_tells_them_apart_by_how_wide_they_look(monkeypatch):
    fitted = []

    def counted(*arguments, **options):
        fitted.append(options.get("along_ray", False))
        return fit_tubes(*arguments, **options)

    monkeypatch.setattr(tubes, "fit_tubes", counted)
    views, bounds, _ = crossing(0.003, 0.006)
    clouds = tubes.Clouds.of([view.crop(bounds) for view in views[2:3]], None)
    # the last kind of rope is not there
    radii = Radii(np.array([0.003, 0.006, 0.015]), np.array([0.0002, 0.0003, 0.001]), free=False, held=True)
    few = clouds.thinned(0.003)
    fit, present = tubes.fit_arcs(clouds, few, np.eye(4)[None], radii, strand.Config())
    assert present.values.tolist() == fit.radii.tolist() == [0.003, 0.006]
    # radii that are held need no fit along the rays
    assert not any(fitted)
    model = strand.reconstruct(views[2:3], None, bounds)
    by_length = [chain.radius for chain in model.chains]
    assert by_length == pytest.approx([0.003, 0.006], rel=0.1)


@pytest.mark.parametrize(
    ("radius", "error"), [([], ValueError), ([0.004, -1.0], ValueError), (["a"], TypeError), ("a", TypeError)]
)
def test_wrong_radii_are_refused(radius, error):
    scene = strand.load_scene(SCENES / "s_mid.npz")
    with pytest.raises(error, match="radius"):
        strand.reconstruct(scene.views, radius, scene.bounds)


def test_the_published_method_takes_one_radius():
    scene = strand.load_scene(SCENES / "s_mid.npz")
    with pytest.raises(ValueError, match="radius"):
        strand.reconstruct(scene.views, [0.004, 0.006], scene.bounds, config=strand.Config.published())


def test_radii_agree_within_their_deviations():
    assert agreeing(np.array([0.006, 0.004, 0.00402]), np.full(3, 1e-5)) == [1, 0, 0]
    assert agreeing(np.array([0.004, 0.0044]), np.full(2, 1e-5)) == [0, 1]
    assert agreeing(np.array([0.004, 0.0044]), np.full(2, 1e-4)) == [0, 0]
    assert Radii.given([0.006, 0.004, 0.006]).values.tolist() == [0.004, 0.006]


def test_a_coarse_view_keeps_its_edges():
    points = strip(0.004)[::40]
    stray = np.array([[0.0, 0.05, 0.0]])
    view = strand.View.from_world(np.vstack([points, stray]), CAMERA)
    kept = without_outliers([view], 0.004, Filter())[0].world_points
    assert len(kept) > 0.9 * len(points)
    assert np.abs(kept[:, 1]).max() < 0.01
    assert len(without_outliers([view], 0.004, Filter(usual=1.0))[0].points) < 0.7 * len(points)


def side_by_side(gap):
    """Two straight strands in contact all along."""
    t = np.linspace(-0.1, 0.1, 200)
    chains = [np.stack([t, 0 * t + y, 0 * t + 0.0042], axis=1) for y in (0.0, gap)]
    return strand.synthetic.scene(chains=chains, seed=1)


def test_strands_that_touch_all_along_are_not_taken_for_a_thicker_rope():
    scene = side_by_side(2.02 * 0.0042)
    model = strand.reconstruct(scene.views, None, scene.bounds)
    assert [chain.radius for chain in model.chains] == pytest.approx([0.0042] * 2, rel=0.02)
    assert [chain.length for chain in model.chains] == pytest.approx([0.2] * 2, rel=0.02)


def test_a_far_camera_sees_a_long_rope_whole():
    t = np.linspace(-0.3, 0.3, 600)
    scene = strand.synthetic.scene(chains=[np.stack([t, 0 * t, 0 * t + 0.0042], axis=1)], seed=1)
    (chain,) = strand.reconstruct(scene.views, None, scene.bounds).chains
    assert chain.length == pytest.approx(0.6, rel=0.01)
    assert chain.radius == pytest.approx(0.0042, rel=0.02)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_thin_rope_that_few_pixels_see_keeps_its_own_radius(seed):
    views, bounds, _ = crossing(0.003, 0.005, seed, size=(320, 240), count=3)
    model = strand.reconstruct(views, [0.003, 0.005], bounds)
    assert sorted(chain.radius for chain in model.chains) == pytest.approx([0.003, 0.005], rel=0.01)
