"""Radii from the data: of one rope, of several, from one view, and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import CAMERA, find_warnings, render_crossing, sample_strip
from strand.reconstruction.radius import Radii, group_radii


@pytest.mark.parametrize("depth_noise", [0.0, 1e-3, 3e-3])
@pytest.mark.parametrize("radius", [0.002, 0.005, 0.01])
def test_a_strip_gives_its_radius_whatever_the_noise_in_depth(radius, depth_noise):
    view = strand.View.from_world(sample_strip(radius, depth_noise), CAMERA)
    radii, sd = strand.estimate_radius([view])
    assert radii[0] == pytest.approx(radius, rel=0.06)
    assert np.abs(radii[0] - radius) < 2 * sd[0]
    assert 0.05 * radius <= sd[0] < 0.2 * radius


def test_the_estimate_moves_with_the_data_and_scales_with_it():
    points = sample_strip(0.004)
    (radius,), _ = strand.estimate_radius([strand.View.from_world(points, CAMERA)])
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = strand.View.from_world(points @ turn.T + [1.0, 2.0, 3.0], turn @ CAMERA + [1.0, 2.0, 3.0])
    assert strand.estimate_radius([moved])[0][0] == pytest.approx(radius, rel=0.02)
    twice = strand.View.from_world(2 * points, 2 * CAMERA)
    assert strand.estimate_radius([twice])[0][0] == pytest.approx(2 * radius, rel=0.02)
    shuffled = strand.View.from_world(np.random.default_rng(1).permutation(points), CAMERA)
    assert strand.estimate_radius([shuffled])[0][0] == pytest.approx(radius, rel=0.02)


def test_the_estimate_is_the_same_for_any_number_of_threads(threads):
    view = strand.View.from_world(sample_strip(0.004, 1e-3), CAMERA)
    answers = []
    for count in (1, 2, 3):
        threads(count)
        answers.append(strand.estimate_radius([view])[0].tobytes())
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
    ("name", "limit"), [("s_0.3mm", 0.01), ("coil_0.7mm", 0.01), ("hard03", 0.02), ("s_1.5mm", 0.03)]
)
def test_a_reconstruction_finds_the_radius(collected, name, limit):
    scene = collected(name)
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
    views, bounds, _ = render_crossing(thin, thick)
    model = strand.reconstruct(views, None, bounds)
    assert len(model.chains) == 2
    by_length = [chain.radius for chain in model.chains]
    assert by_length == pytest.approx([thin, thick], rel=0.03)
    assert all(0 < chain.radius_sd < 0.03 * chain.radius for chain in model.chains)


@pytest.mark.parametrize(("crossings", "views", "seed"), [(7, 7, 32006), (10, 3, 32045)])
def test_a_radius_is_as_sure_as_it_is_right_in_a_heap(crossings, views, seed):
    chains = strand.synthetic.random_ropes(crossings, 3, seed=seed)
    scene = strand.synthetic.scene(chains=chains, seed=seed, views=views)
    for radius in (None, scene.radius):
        model = strand.reconstruct(scene.views, radius, scene.bounds)
        assert len(model.chains) == len(chains)
        for chain in model.chains:
            assert abs(chain.radius - scene.radius) < 2.5 * chain.radius_sd


def test_ropes_that_do_not_differ_share_one_radius():
    views, bounds, _ = render_crossing(0.004, 0.004)
    model = strand.reconstruct(views, None, bounds)
    assert len(model.chains) == 2
    assert model.chains[0].radius == model.chains[1].radius == pytest.approx(0.004, rel=0.02)


def test_radii_that_are_known_are_kept_and_told_apart():
    views, bounds, truth = render_crossing(0.003, 0.006)
    model = strand.reconstruct(views, [0.006, 0.003], bounds)
    assert [chain.radius for chain in model.chains] == pytest.approx([0.003, 0.006], rel=0.01)
    assert all(0 < chain.radius_sd <= 0.003 * chain.radius for chain in model.chains)
    for chain, axis in zip(model.chains, truth, strict=True):
        off = strand.Chain(axis, chain.radius).nearest(chain.points[2:-2]).distance
        assert np.sqrt(np.mean(np.square(off))) < 3e-4


def test_one_view_says_how_little_it_knows(collected):
    scene = collected("s_0.7mm")
    model = strand.reconstruct([scene.views[3]], None, scene.bounds)
    chain = model.chains[0]
    assert abs(chain.radius - scene.radius) < 2 * chain.radius_sd < 0.6 * scene.radius
    assert len(find_warnings(model, "radius")) == 1


@pytest.mark.parametrize(
    ("radius", "error"), [([], ValueError), ([0.004, -1.0], ValueError), (["a"], TypeError), ("a", TypeError)]
)
def test_wrong_radii_are_refused(collected, radius, error):
    scene = collected("s_0.7mm")
    with pytest.raises(error, match="radius"):
        strand.reconstruct(scene.views, radius, scene.bounds)


def test_radii_agree_within_their_deviations():
    assert group_radii(np.array([0.006, 0.004, 0.00402]), np.full(3, 1e-5)) == [1, 0, 0]
    assert group_radii(np.array([0.004, 0.0044]), np.full(2, 1e-5)) == [0, 1]
    assert group_radii(np.array([0.004, 0.0044]), np.full(2, 1e-4)) == [0, 0]
    assert Radii.from_caller([0.006, 0.004, 0.006]).values.tolist() == [0.004, 0.006]


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
    views, bounds, _ = render_crossing(0.003, 0.005, seed, size=(320, 240), count=3)
    model = strand.reconstruct(views, [0.003, 0.005], bounds)
    assert sorted(chain.radius for chain in model.chains) == pytest.approx([0.003, 0.005], rel=0.01)


@pytest.mark.parametrize("radius", [0.003, 0.0042, 0.006, 0.010])
def test_the_radius_is_found_from_the_data(radius):
    scene = strand.synthetic.scene("s", seed=4, radius=radius)
    model = strand.reconstruct(scene.views, bounds=scene.bounds)
    assert model.chains[0].radius == pytest.approx(radius, rel=0.02)
    assert len(model.chains) == 1


def test_a_radius_from_one_view_comes_with_a_warning(paper):
    model = strand.reconstruct([paper.views[3]], bounds=paper.bounds)
    assert len(find_warnings(model, "radius")) == 1
    given = strand.reconstruct([paper.views[3]], paper.radius, paper.bounds)
    assert find_warnings(given, "radius") == []
