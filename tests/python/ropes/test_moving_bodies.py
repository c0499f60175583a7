"""Moving spheres and boxes against tubes: brute force in NumPy, and cases with a known answer."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import strand
from shared.tubes import (
    NO_POSES,
    SEEDS,
    draw_near_nodes,
    draw_random_model,
    draw_random_motion,
    draw_rope_along_x,
    measure_by_brute_force,
    place_along,
)
from strand import Chain, Model


@pytest.mark.parametrize("seed", SEEDS)
def test_spheres_that_move_touch_and_pass_as_brute_force_says(seed):
    model, rng = draw_random_model(seed)
    starts, ends = 0.08 * rng.normal(size=(200, 3)), draw_near_nodes(model, rng, 200, 0.03)
    ends[:10] = starts[:10]
    radius = rng.uniform(0, 0.02, 200)
    got = model.swept_spheres(starts, ends, radius)
    count = 200
    places = place_along(starts, ends, np.linspace(0.0, 1.0, count + 1)[:, None])
    apart = np.array([measure_by_brute_force(model.chains, at).min(axis=0) for at in places]) - radius
    # between two places the distance falls by half a step at most
    step = np.linalg.norm(ends - starts, axis=1) / count
    assert (got.clearance <= apart.min(axis=0) + 1e-13).all()
    assert (got.clearance >= apart.min(axis=0) - 0.5 * step - 1e-13).all()
    touched = np.isfinite(got.time)
    np.testing.assert_array_equal(touched, got.clearance <= 0)
    assert 5 < touched.sum() < 200
    first = place_along(starts, ends, np.where(touched, got.time, 0.0))
    there = measure_by_brute_force(model.chains, first)[got.chain, np.arange(200)] - radius
    later = touched & (got.time > 0)
    np.testing.assert_allclose(there[later], 0.0, atol=1e-12)
    np.testing.assert_array_equal(got.time[apart[0] <= 0], 0.0)
    before = np.arange(count + 1)[:, None] / count < got.time
    assert (apart[before] > -1e-12).all()
    alike = model.swept_spheres(starts, ends, 0.01)
    np.testing.assert_array_equal(alike.time, model.swept_spheres(starts, ends, np.full(200, 0.01)).time)


def turn_pose(start, end, times):
    """Return (T, 4, 4) the poses of a box that moves and turns."""
    between = Rotation.from_matrix(end[:3, :3] @ start[:3, :3].T).as_rotvec()
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(times[:, None] * between).as_matrix() @ start[:3, :3]
    poses[:, :3, 3] = place_along(start[:3, 3], end[:3, 3], times)
    return poses


def measure_box(model, poses, half, spacing):
    """Return (T,) the distance of a box at some poses from the surfaces, by places of the axes."""
    least = np.full(len(poses), np.inf)
    for chain in model.chains:
        places = chain.at(np.linspace(0.0, chain.length, int(chain.length / spacing) + 2))
        inside = (places - poses[:, None, :3, 3]) @ poses[:, :3, :3]
        beyond = np.linalg.norm(np.maximum(np.abs(inside) - half, 0.0), axis=2)
        least = np.minimum(least, beyond.min(axis=1) - chain.radius)
    return least


@pytest.mark.parametrize("turns", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_boxes_that_move_and_turn_touch_and_pass_as_brute_force_says(seed, turns):
    model, rng = draw_random_model(seed)
    boxes, spacing, count = 10, 4e-4, 80
    starts, ends = (np.array([draw_random_motion(rng) for _ in range(boxes)]) for _ in range(2))
    starts[:, :3, 3] *= 0.08
    ends[:, :3, 3] = draw_near_nodes(model, rng, boxes, 0.06)
    if not turns:
        ends[:, :3, :3] = starts[:, :3, :3]
    half = rng.uniform(0.0, 0.02, (boxes, 3))
    got = model.swept_boxes(starts, ends, half)
    times = np.linspace(0.0, 1.0, count + 1)
    for i in range(boxes):
        apart = measure_box(model, turn_pose(starts[i], ends[i], times), half[i], spacing)
        turn = np.pi * np.linalg.norm(half[i]) if turns else 0.0
        step = (np.linalg.norm(ends[i, :3, 3] - starts[i, :3, 3]) + turn) / count
        slack = 1e-6 + 1e-5 * turn
        assert got.clearance[i] <= apart.min() + 1e-12
        assert got.clearance[i] >= apart.min() - 0.5 * step - 0.5 * spacing - slack
        if np.isinf(got.time[i]):
            assert got.clearance[i] > 0
            continue
        assert got.clearance[i] <= slack
        there = measure_box(model, turn_pose(starts[i], ends[i], got.time[i : i + 1]), half[i], spacing)[0]
        assert there <= slack + 0.5 * spacing
        assert got.time[i] == 0 or there >= 0
        assert (apart[times < got.time[i]] > 0).all()
    assert np.isfinite(got.time).any()


def test_a_box_that_falls_on_a_rope_touches_when_its_face_does():
    start, end = np.eye(4)[None].copy(), np.eye(4)[None].copy()
    start[0, 2, 3] = 0.1
    got = draw_rope_along_x().swept_boxes(start, end, (0.03, 0.02, 0.01))
    assert got.time[0] == pytest.approx(0.85, abs=2e-5)
    assert got.time[0] <= 0.85
    assert got.clearance[0] == -0.005
    # beside it, it passes by 2 mm
    start[0, 1, 3] = end[0, 1, 3] = 0.027
    got = draw_rope_along_x().swept_boxes(start, end, (0.03, 0.02, 0.01))
    assert np.isinf(got.time[0])
    assert got.clearance[0] == pytest.approx(0.002, abs=1e-6)
    assert got.clearance[0] <= 0.002 + 1e-15


def test_a_bar_that_turns_touches_a_post_at_the_angle_that_geometry_says():
    post = Model((Chain(np.array([[0.06, 0.08, -0.1], [0.06, 0.08, 0.1]]), 0.01),), NO_POSES)
    start, end = np.eye(4)[None].copy(), np.eye(4)[None].copy()
    end[0, :3, :3] = strand.rotation_xyz(0.0, 0.0, np.pi / 2)
    got = post.swept_boxes(start, end, (0.15, 0.0, 0.0))
    expected = (np.arctan2(0.08, 0.06) - np.arcsin(0.01 / 0.1)) / (np.pi / 2)
    assert got.time[0] == pytest.approx(expected, abs=1e-4)
    assert got.time[0] <= expected
    assert got.s[0] == pytest.approx(0.1, abs=0.1)
    short = post.swept_boxes(start, end, (0.08, 0.0, 0.0))
    assert np.isinf(short.time[0])
    assert short.clearance[0] == pytest.approx(0.01, abs=3e-6)
