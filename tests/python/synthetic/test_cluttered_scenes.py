"""Scenes with other objects beside the rope."""

from __future__ import annotations

import numpy as np
import pytest

from strand.synthetic import camera_pose, cluttered_scene
from strand.synthetic.objects import Ball, Box, Cylinder, add_objects

K = np.array([[400.0, 0.0, 160.0], [0.0, 400.0, 120.0], [0.0, 0.0, 1.0]])


def test_the_same_seed_gives_the_same_bits_with_and_without_a_rope():
    made, again = cluttered_scene(4), cluttered_scene(4)
    assert made.name == "cluttered04_1v"
    assert np.array_equal(made.depth, again.depth)
    assert np.array_equal(made.poses[0], np.eye(4))
    without = cluttered_scene(4, rope=False)
    assert without.truth == ()
    assert without.radius == made.radius


def test_views_show_the_rope_between_objects():
    made = cluttered_scene(5)
    assert made.depth.shape == (3, 480, 640)
    seen = np.zeros(len(made.truth[0]), dtype=bool)
    for depth, pose in zip(made.depth, made.poses_true, strict=True):
        x, y, z = ((made.truth[0] - pose[:3, 3]) @ pose[:3, :3]).T
        u = np.rint(made.intrinsics[0, 0] * x / z + made.intrinsics[0, 2]).astype(int)
        v = np.rint(made.intrinsics[1, 1] * y / z + made.intrinsics[1, 2]).astype(int)
        away = depth[v, u] * made.depth_scale - z
        # the rope also hides parts of itself
        seen |= away > -6.0 * made.radius
        assert np.median(away) == pytest.approx(-made.radius, abs=0.4 * made.radius)
    assert seen.all()


@pytest.mark.parametrize(
    ("thing", "height"),
    [
        (Box((0.0, 0.0, 0.02), (0.1, 0.06, 0.04), 0.7), 0.04),
        (Ball((0.0, 0.0, 0.03), 0.03), 0.06),
        (Cylinder((0.0, 0.0, 0.0), 0.02, 0.05), 0.05),
        (Cylinder((0.0, 0.0, 0.0), 0.02, 0.05, hollow=True), 0.0),
    ],
)
def test_objects_have_their_height_from_above(thing, height):
    pose = camera_pose(0.0, 0.5, np.pi / 2)
    depth = add_objects(np.full((240, 320), 0.5), [thing], K, pose)
    assert depth[120, 160] == pytest.approx(0.5 - height, abs=1e-9)
    covered = np.count_nonzero(depth < 0.5 - 1e-9)
    areas = {Box: 0.1 * 0.06, Ball: np.pi * 0.03**2, Cylinder: np.pi * 0.02**2}
    # nearer parts look larger: the size is between that on the table and that at the top
    low, high = areas[type(thing)] * (400.0 / 0.5) ** 2, areas[type(thing)] * (400.0 / 0.44) ** 2
    if not getattr(thing, "hollow", False):
        assert 0.95 * low < covered < 1.05 * high


def test_wrong_arguments():
    with pytest.raises(ValueError, match="seed"):
        cluttered_scene(-1)
    with pytest.raises(ValueError, match="views"):
        cluttered_scene(0, views=0)
    with pytest.raises(TypeError, match="rope"):
        cluttered_scene(0, rope="no")
