"""Scenes that are hard to see for one reason each."""

from __future__ import annotations

import numpy as np
import pytest

from strand.synthetic import CAMERAS, ROUGH, render_depth, rough_scene


def width(made):
    """Return the ropes' radius in the middle view, pixels."""
    pose = made.poses_true[len(made.poses_true) // 2]
    depth = ((np.concatenate(made.truth) - pose[:3, 3]) @ pose[:3, :3])[:, 2]
    return made.intrinsics[0, 0] * made.radius / np.median(depth)


def shown(made, i):
    """Return the pixels that would show a rope without obstacles."""
    height, columns = made.depth.shape[1:]
    return (
        render_depth(made.truth, made.radius, made.intrinsics, made.poses_true[i], (columns, height), False)
        > 0
    )


@pytest.mark.parametrize("kind", ROUGH)
def test_every_kind_has_masks_and_noise_and_the_same_bits_again(kind):
    made, again = rough_scene(kind, 2), rough_scene(kind, 2)
    assert made.name == f"{kind}02_zed_1v"
    assert made.depth.shape == (1, 480, 640)
    for first, second in ((made.depth, again.depth), (made.mask, again.mask), (made.poses, again.poses)):
        assert np.array_equal(first, second)
    assert 0.15 < made.noise / made.radius < 2.0
    assert made.mask[0].sum() > 200
    assert len(made.views[0].points) > 150


def test_odd_seeds_have_three_views_with_wrong_poses_but_for_the_middle_one():
    made = rough_scene("thin", 7)
    assert made.name == "thin07_zed_3v"
    assert made.depth.shape == made.mask.shape == (3, 480, 640)
    assert np.array_equal(made.poses[1], made.poses_true[1])
    for i in (0, 2):
        assert 0 < np.abs(made.poses[i] - made.poses_true[i]).max() < 0.02


def test_widths():
    assert width(rough_scene("thin", 0)) == pytest.approx(2.5, rel=0.15)
    assert width(rough_scene("thick", 0)) == pytest.approx(8.0, rel=0.15)
    assert width(rough_scene("thick", 2)) == pytest.approx(20.0, rel=0.2)
    assert 3.5 < width(rough_scene("missing", 0)) < 7.0


def test_a_third_of_the_depth_is_missing():
    for seed in (0, 4):
        made = rough_scene("missing", seed)
        rope = shown(made, 0)
        assert (made.depth[0][rope] == 0).mean() == pytest.approx(1 / 3, abs=0.1)
        assert made.mask[0][rope].mean() > 0.6  # the mask still has these pixels


def test_ragged_masks():
    made = rough_scene("ragged", 0)
    rope = shown(made, 0)
    lost, taken = rope & ~made.mask[0], made.mask[0] & ~rope
    assert lost.sum() > 0.08 * rope.sum()
    assert taken.sum() > 0.08 * rope.sum()
    rows, columns = np.nonzero(taken)
    near = np.pad(rope, 15)
    assert any(not near[v : v + 31, u : u + 31].any() for v, u in zip(rows, columns, strict=True))  # specks


@pytest.mark.parametrize("seed", range(4))
def test_a_bar_hides_6_to_15_radii(seed):
    made = rough_scene("bar", seed, views=1)
    pose = made.poses_true[0]
    nodes = np.concatenate(made.truth)
    seen = (nodes - pose[:3, 3]) @ pose[:3, :3]
    column, row = np.rint((seen @ made.intrinsics.T)[:, :2] / seen[:, 2:]).astype(int).T
    in_front = made.depth[0][row, column] * made.depth_scale < seen[:, 2] - 4.5 * made.radius
    spacing = np.linalg.norm(made.truth[0][1] - made.truth[0][0]) / made.radius
    assert 4.0 < in_front.sum() * spacing < 18.0


def test_hanging_ropes_have_nothing_near_behind_them():
    made = rough_scene("hanging", 0)
    depth = made.depth[0] * made.depth_scale
    rope, beside = np.median(depth[shown(made, 0)]), np.median(depth[~made.mask[0]])
    assert 0.35 < beside - rope < 1.1
    assert np.ptp(made.truth[0][:, 2]) > 5 * made.radius  # upright


def test_cameras_and_views_can_be_chosen():
    made = rough_scene("thin", 0, device="tof", views=2)
    assert made.name == "thin00_tof_2v"
    assert len(made.depth) == 2
    own = rough_scene("thin", 0, device=CAMERAS["tof"], views=2)
    assert np.array_equal(made.depth, own.depth)


def test_wrong_input():
    with pytest.raises(ValueError, match="kind: expected one of thin, thick"):
        rough_scene("dark")
    with pytest.raises(ValueError, match="seed: expected at least 0"):
        rough_scene("thin", -1)
    with pytest.raises(TypeError, match="views: expected an integer"):
        rough_scene("thin", views=1.5)
    with pytest.raises(ValueError, match="device: expected one of"):
        rough_scene("thin", device="kinect")
