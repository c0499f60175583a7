"""When nothing lies in the extraction range, the error says where the points are and the likely cause."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand

SCENE = strand.synthetic.scene("arc", views=2)
DEPTH, K = SCENE.depth * SCENE.depth_scale, SCENE.intrinsics
POSES, BOUNDS = SCENE.poses, SCENE.bounds


def message(views, bounds=BOUNDS):
    with pytest.raises(strand.NotEnoughDataError) as caught:
        strand.reconstruct(views, SCENE.radius, bounds)
    return str(caught.value)


def images(depth=DEPTH, intrinsics=K, poses=POSES):
    return [strand.View.from_depth(d, intrinsics, p) for d, p in zip(depth, poses, strict=True)]


@pytest.mark.parametrize("bounds", [None, BOUNDS])
def test_a_radius_in_millimetres(bounds):
    with pytest.raises(strand.NotEnoughDataError, match=r"radius: a rope 8\.4 m wide .* is it in metres\?"):
        strand.reconstruct(images(), 1e3 * SCENE.radius, bounds)


def test_the_span_of_the_points_and_the_range_are_named():
    low, high = np.array([10.0, 10.0, 10.0]), np.array([11.0, 12.0, 13.0])
    said = message(images(), (low, high))
    points = np.concatenate([view.world_points for view in images()])
    assert "the range is (10, 10, 10) to (11, 12, 13) m" in said
    assert f"the points lie between ({points[:, 0].min():.4g}, " in said
    assert f"{points[:, 2].max():.4g}) m, the range" in said
    assert said.endswith("are bounds, poses and units those of one world frame, in metres?")


@pytest.mark.parametrize("kind", ["images", "points"])
def test_depths_in_millimetres(kind):
    views = images(1e3 * DEPTH)
    if kind == "points":
        views = [strand.View(1e3 * view.points, view.pose) for view in images()]
    assert "depths look like millimetres: give depth_scale=0.001" in message(views)


def test_points_and_poses_in_millimetres():
    views = [strand.View.from_world(1e3 * view.world_points, 1e3 * view.viewpoint) for view in images()]
    assert "points and poses look like millimetres" in message(views)


def test_bounds_in_millimetres():
    assert "bounds look like millimetres" in message(images(), tuple(1e3 * corner for corner in BOUNDS))


def test_points_that_are_in_the_world_frame_already():
    views = [strand.View(view.world_points, view.pose) for view in images()]
    assert "points look like world-frame ones: use View.from_world" in message(views)


def test_points_without_a_camera_frame_are_told_of_none():
    views = [strand.View.from_world(view.points, view.viewpoint) for view in images()]
    assert "camera frame" not in message(views)


def test_a_stray_point_makes_no_cause_likely():
    high = np.array([0.0, 0.0, 30.0])
    points = np.concatenate([np.tile(high, (5000, 1)), 1e3 * SCENE.truth[0][:1]])
    said = message([strand.View.from_world(points, [0.0, 0.0, 9.0])])
    assert said.endswith("are bounds, poses and units those of one world frame, in metres?")


def test_poses_that_lead_from_the_world_to_the_camera():
    assert "poses look like world-to-camera ones" in message(images(poses=np.linalg.inv(POSES)))


@pytest.mark.parametrize(
    ("name", "turn"),
    [
        ("x right, y up, z backward", np.diag([1.0, -1.0, -1.0])),
        ("x forward, y left, z up", np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])),
    ],
)
def test_a_camera_frame_of_another_convention(name, turn):
    views = [strand.View(view.points @ turn.T, view.pose) for view in images()]
    assert f"the camera frame looks like {name}" in message(views)


def test_intrinsics_of_an_image_of_another_size():
    larger = K * [[4.0], [4.0], [1.0]]
    assert "intrinsics look like those of an image of another size" in message(images(intrinsics=larger))


def test_no_points_at_all():
    assert "no view has a point; are all depths 0 or not finite?" in message(images(0.0 * DEPTH))
    assert "no view has a point" in message([strand.View(np.empty((0, 3)))], None)
    assert "no view has a point" in message([strand.View.from_depth(np.empty((1, 0)), K)], None)


def test_masks_without_a_point_are_named():
    empty = np.zeros(DEPTH.shape, dtype=bool)
    views = dataclasses.replace(SCENE, mask=empty).views
    said = message(views)
    assert said.startswith(
        "views: no view has a point: view 0 has an empty mask, view 1 has an empty mask; 0 in"
    )
    assert message(views, None) == said
    blind = np.where(np.arange(DEPTH.shape[2]) < 9, 0.0, DEPTH)
    masks = empty | (np.arange(DEPTH.shape[2]) < 9)
    views = [strand.View.from_depth(d, K, p, mask=m) for d, p, m in zip(blind, POSES, masks, strict=True)]
    assert "view 0 has no depth inside its mask, view 1 has no depth inside its mask;" in message(views)


def test_masks_of_other_frames_hold_nothing_of_the_range():
    beside = np.zeros(DEPTH.shape, dtype=bool)
    beside[:, -9:] = True
    said = message(dataclasses.replace(SCENE, mask=beside).views)
    assert said.endswith("points outside of the masks do lie there: are the masks those of these frames?")
