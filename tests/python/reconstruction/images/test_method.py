"""Ropes read from images: how they run, in any frame, order of views and number of threads."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.synthetic import Camera, Segmentation, scene

SIZE = (320, 240)
SCENES = {
    name: scene(name, seed=seed, views=3, camera=Camera("zed", size=SIZE), mask=Segmentation())
    for name, seed in (("loop", 2), ("overhand", 2), ("arc", 1))
}


def reconstructed(made, views=None, ropes=1, bounds=True):
    views = made.views if views is None else views
    return strand.reconstruct(views, made.radius, made.bounds if bounds else None, ropes=ropes)


def nodes(model):
    return [chain.points for chain in model.chains]


@pytest.fixture(scope="module")
def loop():
    return reconstructed(SCENES["loop"])


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("ropes", [None, 1])
def test_a_rope_is_right_and_said_to_be_read_from_images(name, ropes, measure):
    made = SCENES[name]
    model = reconstructed(made, ropes=ropes)
    found = measure(model, made.truth, made.radius)
    assert found.right
    assert found.rms < 0.3 * made.radius
    assert {"images", "readings", "explain"} <= set(model.timings)
    (chain,) = model.chains
    assert (np.linalg.eigvalsh(chain.covariance) > 0).all()
    assert np.isfinite(model.poses).all()
    assert 0.0 < model.confidence < 1.0


def test_moving_the_world_moves_the_ropes(loop):
    made = SCENES["loop"]
    motion = np.eye(4)
    motion[:3, :3] = strand.pose_from_angles(0.4, -0.3, 1.1, [0, 0, 0])[:3, :3]
    motion[:3, 3] = 0.3, -0.2, 0.5
    moved = dataclasses.replace(made, poses=motion @ made.poses)
    model, still = reconstructed(moved, bounds=False), reconstructed(made, bounds=False)
    (there,), (here,) = nodes(model), nodes(still)
    expected = here @ motion[:3, :3].T + motion[:3, 3]
    ways = [np.abs(there - way).max() for way in (expected, expected[::-1]) if len(there) == len(way)]
    assert min(ways) < 0.05 * made.radius


def test_the_order_of_the_outer_views_does_not_matter(loop):
    made = SCENES["loop"]
    (turned,), (given,) = nodes(reconstructed(made, made.views[::-1])), nodes(loop)
    assert len(turned) == len(given)
    assert np.abs(turned - given).max() < 0.05 * made.radius


@pytest.mark.parametrize("given", [False, True])
@pytest.mark.parametrize("bounds", [False, True])
def test_depths_that_are_nan_or_infinite_are_as_none(given, bounds):
    made = SCENES["loop"]
    # whole stretches of rope too
    lost = np.random.default_rng(0).random(made.depth.shape) < 0.3
    lost[:, :, :120] = True
    answers = []
    for value in (0.0, np.nan, np.inf):
        depth = np.where(lost, value, made.depth * made.depth_scale)
        views = [
            strand.View.from_depth(d, made.intrinsics, pose, mask=mask)
            for d, pose, mask in zip(depth, made.poses, made.mask, strict=True)
        ]
        model = strand.reconstruct(views, made.radius if given else None, made.bounds if bounds else None)
        answers.append(([points.tobytes() for points in nodes(model)], model.confidence))
    assert answers[0] == answers[1] == answers[2]


def test_the_bits_are_the_same_for_any_number_of_threads(threads):
    made = SCENES["overhand"]
    answers = []
    for count in (1, 3):
        threads(count)
        model = reconstructed(made)
        answers.append(
            (
                [(chain.points.tobytes(), chain.covariance.tobytes()) for chain in model.chains],
                model.poses.tobytes(),
                model.confidence,
            )
        )
    assert answers[0] == answers[1]


def test_pixels_inside_a_mask_need_no_depth(measure):
    made = SCENES["loop"]
    rng = np.random.default_rng(1)
    lost = made.mask & (rng.uniform(size=made.mask.shape) < 0.3)
    holes = dataclasses.replace(made, depth=np.where(lost, 0, made.depth).astype(made.depth.dtype))
    assert measure(reconstructed(holes), made.truth, made.radius).right


def test_views_with_and_without_masks_go_together(measure):
    made = SCENES["loop"]
    bare = dataclasses.replace(made, mask=None).views
    low, high = made.bounds
    bounds = (np.array([low[0], low[1], 1.0 * made.radius]), high)
    model = strand.reconstruct([made.views[0], made.views[1], bare[2]], made.radius, bounds, ropes=1)
    assert measure(model, made.truth, made.radius).right


def test_one_view_is_enough_for_how_a_rope_runs():
    made = SCENES["overhand"]
    model = reconstructed(made, [made.views[1]])
    assert len(model.chains) == 1
    assert model.chains[0].length == pytest.approx(strand.Chain(made.truth[0], made.radius).length, rel=0.1)
