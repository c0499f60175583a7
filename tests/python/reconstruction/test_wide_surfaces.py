"""Points that are no ropes are refused early; ropes never are, however they lie."""

from __future__ import annotations

import time

import numpy as np
import pytest

import strand
from shared.ropes import R, sample_tube
from strand.reconstruction.wide_surfaces import describe_surface

CAMERA = np.array([0.0, 0.0, 0.5])


def plane(rng, count, side=0.3):
    points = rng.uniform(-0.5 * side, 0.5 * side, (count, 3))
    points[:, 2] = rng.normal(scale=5e-4, size=count)
    return points


def ball(rng, count):
    outward = rng.normal(size=(count, 3))
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    return 0.06 * outward[outward[:, 2] > 0.3] + rng.normal(
        scale=3e-4, size=(int((outward[:, 2] > 0.3).sum()), 3)
    )


def filled(rng, count):
    return rng.uniform(-0.05, 0.05, (count, 3))


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        (plane, "no rope on the table|points look like a smooth surface"),
        (ball, "points look like a smooth surface"),
        (filled, "points look like a cloud that fills space"),
    ],
)
@pytest.mark.parametrize("known", [{}, {"ropes": 1}, {"config": strand.Config.published()}])
def test_what_is_no_rope_is_refused_before_it_is_searched(shape, said, known):
    points = shape(np.random.default_rng(0), 40_000)
    views = [strand.View.from_world(points, CAMERA)]
    start = time.process_time()
    with pytest.raises(strand.NotEnoughDataError, match=f"({said}).*bounds"):
        strand.reconstruct(views, R, **known)
    # a search takes a minute
    assert time.process_time() - start < 5.0


@pytest.mark.parametrize("images", [True, False])
def test_a_table_that_was_left_in_is_told_from_the_rope(images, measure):
    scene = strand.synthetic.scene("arc", seed=1, views=3)
    views = scene.views
    if not images:
        views = [strand.View.from_world(view.world_points, view.viewpoint) for view in views]
    assert measure(strand.reconstruct(views, scene.radius), scene.truth, scene.radius).right


def rug(turns, noise):
    """A flat spiral of strands that touch, as seen from above."""
    angle = np.arange(2.0 * np.pi, 2.0 * np.pi * turns, 0.02)
    out = 2.0 * R * angle / (2.0 * np.pi)
    axis = np.stack([out * np.cos(angle), out * np.sin(angle), np.full(len(angle), R)], axis=1)
    axis = axis[np.append(True, np.linalg.norm(np.diff(axis, axis=0), axis=1) > 1e-6)]
    return sample_tube(axis, CAMERA, noise)


def test_strands_side_by_side_are_no_table():
    # a spiral of strands that touch: too close for the run of each to be certain, but a rope
    view = strand.View.from_world(rug(4, 3e-4), CAMERA)
    assert strand.reconstruct([view], R).chains


@pytest.mark.parametrize("turns", [4, 8, 14])
@pytest.mark.parametrize("noise", [0.0, 3e-4, 1e-3])
def test_strands_side_by_side_may_be_ropes(turns, noise):
    assert describe_surface([strand.View.from_world(rug(turns, noise), CAMERA)], R) is None


@pytest.mark.parametrize("wide", [0.5, 1.0, 1.5])
def test_a_rope_in_wide_noise_may_be_a_rope(wide):
    axis = np.stack(
        [np.linspace(-0.2, 0.2, 200), 0.03 * np.sin(np.linspace(0, 6, 200)), np.full(200, R)], axis=1
    )
    assert describe_surface([strand.View.from_world(sample_tube(axis, CAMERA, wide * R), CAMERA)], R) is None


def test_the_collection_holds_ropes(collected):
    for name in ("heap06", "hard00", "coil_1.5mm", "two_ropes", "random_6"):
        scene = collected(name)
        assert describe_surface([view.crop(scene.bounds) for view in scene.views], scene.radius) is None


def test_views_that_see_little_say_nothing():
    assert describe_surface([strand.View(np.zeros((5, 3)))], R) is None
    assert describe_surface([], R) is None
