"""Which way is up: cameras without a pose, tilted tables, other frames, clouds without a table."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import strand
from strand.geometry.plane import Plane
from strand.reconstruction.images import table_plane
from strand.reconstruction.stages import SoughtTable
from strand.synthetic import Segmentation
from strand.views.view import cropped, placed

GRIPPER = strand.Gripper(opening=0.03, width=0.01, thickness=0.006, depth=0.04)
NAMES = ("overhand", "figure8")
UP = np.array([0.0, 0.0, 1.0])


def turn_about_x(degrees, shift=(0.0, 0.0, 0.0)):
    motion = strand.pose_from_angles(np.radians(degrees), 0.0, 0.0, shift)
    return np.asarray(motion)


def move(motion, points):
    return points @ motion[:3, :3].T + motion[:3, 3]


@cache
def draw(name, views=1, masked=False):
    return strand.synthetic.scene(name, seed=3, views=views, mask=Segmentation() if masked else None)


@cache
def answer_in_world(name, views=1, masked=False):
    scene = draw(name, views, masked)
    return strand.reconstruct(scene.views, scene.radius, scene.bounds)


def put(scene, motion):
    """Return a scene's views and bounds in another world frame."""
    views = [placed(view, motion @ pose) for view, pose in zip(scene.views, scene.poses, strict=True)]
    return views, strand.Box(*scene.bounds, motion)


def assert_same_answer(model, world, motion):
    """Check that crossings, grasps and pulls are those in the world, moved."""
    angle = np.degrees(np.arccos(np.clip(model.up @ motion[:3, :3] @ UP, -1.0, 1.0)))
    assert angle < 3.0
    assert len(model.crossings()) == len(world.crossings()) > 0
    match_crossings(model.crossings(), world.crossings(), motion)
    match_crossings(model.chains[0].crossings(), world.chains[0].crossings(), motion)
    grasps, expected = model.grasps(GRIPPER), world.grasps(GRIPPER)
    assert len(grasps) == pytest.approx(len(expected), rel=0.1)
    for grasp in grasps:
        assert -grasp.approach @ motion[:3, :3] @ UP > 0.7
    pulls, others = model.pull_plan().pulls, world.pull_plan().pulls
    assert len(pulls) == len(others)
    for pull in pulls:
        goal = pull.place + pull.distance * pull.direction
        # it moves along the table, not through it
        assert abs((goal - pull.place) @ motion[:3, :3] @ UP) < 0.05 * pull.distance + 1e-3
    places = np.array([move(motion, other.place) for other in others])
    for pull in pulls[:1]:
        assert np.linalg.norm(places - pull.place, axis=1).min() < 0.01


def match_crossings(found, expected, motion):
    places = np.array([move(motion, other.place) for other in expected])
    for crossing in found:
        k = int(np.linalg.norm(places - crossing.place, axis=1).argmin())
        rise = motion[:3, :3] @ (expected[k].point_over - expected[k].point_under)
        assert np.linalg.norm(places[k] - crossing.place) < 0.005
        assert (crossing.point_over - crossing.point_under) @ rise > 0
        assert crossing.probability == pytest.approx(expected[k].probability, abs=0.05)


def test_a_world_with_z_up_keeps_exactly_z():
    for name, views in (("overhand", 1), ("figure8", 3)):
        model = answer_in_world(name, views)
        np.testing.assert_array_equal(model.up, UP)
        assert model.table.normal == pytest.approx(UP, abs=0.01)
        assert model.table.offset == pytest.approx(0.0, abs=0.001)
        assert all(np.array_equal(chain.up, UP) for chain in model.chains)
        assert not any(doubt.kind == "beneath" for doubt in model.doubts)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("given", ["bounds", "nothing", "mask"])
def test_a_camera_without_a_pose(name, given):
    scene = draw(name, masked=given == "mask")
    motion = np.linalg.inv(scene.poses[0])
    view = strand.View.from_depth(
        scene.depth[0],
        scene.intrinsics,
        depth_scale=scene.depth_scale,
        mask=None if scene.mask is None else scene.mask[0],
    )
    bounds = strand.Box(*scene.bounds, motion) if given == "bounds" else None
    model = strand.reconstruct([view], scene.radius, bounds)
    assert model.up[2] < 0
    assert model.table.measure_heights(np.zeros(3)) > 0.1
    assert_same_answer(model, answer_in_world(name, masked=given == "mask"), motion)
    assert not any(doubt.kind == "beneath" for doubt in model.doubts)


@pytest.mark.parametrize(
    "motion",
    [turn_about_x(17.0), turn_about_x(-90.0, (0.3, 0.0, 1.0))],
    ids=["a tilted table", "a world with y up"],
)
@pytest.mark.parametrize("views", [1, 3])
def test_a_table_that_is_not_level_in_the_world(motion, views):
    scene = draw("overhand", views)
    moved, bounds = put(scene, motion)
    model = strand.reconstruct(moved, scene.radius, bounds)
    assert_same_answer(model, answer_in_world("overhand", views), motion)
    assert not any(doubt.kind == "beneath" for doubt in model.doubts)


def test_several_views_in_the_first_cameras_frame():
    scene = draw("overhand", 3)
    motion = np.linalg.inv(scene.poses[0])
    views, bounds = put(scene, motion)
    model = strand.reconstruct(views, scene.radius, bounds)
    assert_same_answer(model, answer_in_world("overhand", 3), motion)
    assert not any(doubt.kind == "beneath" for doubt in model.doubts)


def test_poses_of_opengl_are_doubted_and_the_order_is_right():
    scene = draw("overhand")
    motion = scene.poses[0] @ np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(scene.poses[0])
    views, bounds = put(scene, motion)
    model = strand.reconstruct(views, scene.radius, bounds)
    assert_same_answer(model, answer_in_world("overhand"), motion)
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "beneath")
    assert doubt.amount > 0.5
    assert model.confidence < 0.8
    (warning,) = (warning for warning in model.warnings if warning.kind == "beneath")
    assert "from beneath" in str(warning)


def test_a_frame_on_the_table_with_z_down_is_hardly_doubted():
    scene = draw("overhand")
    motion = turn_about_x(180.0)
    views, bounds = put(scene, motion)
    model = strand.reconstruct(views, scene.radius, bounds)
    assert_same_answer(model, answer_in_world("overhand"), motion)
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "beneath")
    assert doubt.amount < 0.1


def test_points_with_a_table_have_its_normal_and_points_of_ropes_their_own():
    scene = draw("overhand")
    motion = np.linalg.inv(scene.poses[0])
    (view,), bounds = put(scene, motion)
    cloud = strand.View(view.points)
    model = strand.reconstruct([cloud], scene.radius, bounds)
    assert model.table.normal == pytest.approx(motion[:3, :3] @ UP, abs=0.02)
    assert_same_answer(model, answer_in_world("overhand"), motion)
    (ropes,) = cropped([cloud], bounds)
    model = strand.reconstruct([ropes], scene.radius)
    assert model.table is None
    assert model.up == pytest.approx(motion[:3, :3] @ UP, abs=0.05)
    match_crossings(model.crossings(), answer_in_world("overhand").crossings(), motion)


def test_points_of_a_straight_rope_are_seen_from_their_camera():
    scene = strand.synthetic.scene("straight", seed=3, views=1)
    (ropes,) = cropped(scene.views, strand.Box(*scene.bounds))
    model = strand.reconstruct([strand.View(ropes.points)], scene.radius)
    middle = model.chains[0].points.mean(axis=0)
    assert model.table is None
    assert model.up == pytest.approx(-middle / np.linalg.norm(middle), abs=1e-9)


def test_the_table_of_an_earlier_model_counts_where_none_is_seen():
    scene = draw("overhand")
    motion = np.linalg.inv(scene.poses[0])
    (view,), bounds = put(scene, motion)
    first = strand.reconstruct([view], scene.radius, bounds)
    (ropes,) = cropped([strand.View(view.points)], bounds)
    model = strand.reconstruct([ropes], scene.radius, previous=first)
    np.testing.assert_array_equal(model.up, first.up)
    assert model.table.offset == first.table.offset
    assert_same_answer(model, answer_in_world("overhand"), motion)
    # a plane that the ropes lie beneath is no table of theirs
    high = replace(first, table=Plane(first.table.normal, first.table.offset + 0.1))
    assert strand.reconstruct([ropes], scene.radius, previous=high).table is None


def test_the_published_method_has_a_table_too():
    scene = draw("loop", 3)
    motion = np.linalg.inv(scene.poses[0])
    views, bounds = put(scene, motion)
    model = strand.reconstruct(views, scene.radius, bounds, config=strand.Config.published())
    assert model.up == pytest.approx(motion[:3, :3] @ UP, abs=0.02)


def test_the_table_beside_masks_is_sought_once(monkeypatch):
    scene = draw("overhand", masked=True)
    expected = strand.reconstruct(scene.views, scene.radius).table
    wrong = 0.6 * scene.radius
    doubts = strand.reconstruct(scene.views, wrong).doubts
    assert any(doubt.kind == "radius" for doubt in doubts)
    images = [view.image for view in scene.views]
    sought = table_plane.find_table_beside_ropes(images[0], scene.radius)
    assert expected.normal == pytest.approx(sought.normal, abs=1e-9)
    # the reading of images has its own name of this function
    monkeypatch.setattr(table_plane, "find_table_beside_ropes", None)
    again = strand.reconstruct(scene.views, scene.radius).table
    np.testing.assert_array_equal(again.normal, expected.normal)
    assert list(map(str, strand.reconstruct(scene.views, wrong).doubts)) == list(map(str, doubts))
    known = SoughtTable(images[0], scene.radius, sought)
    assert known.holds_for(replace(images[0]), scene.radius)
    assert known.holds_for(replace(images[0], pose=images[0].pose.copy()), scene.radius)
    moved = images[0].pose.copy()
    moved[0, 3] += 0.1
    assert not known.holds_for(replace(images[0], pose=moved), scene.radius)
    assert not known.holds_for(
        replace(images[0], camera=images[0].camera.magnified(2, (0.0, 0.0))), scene.radius
    )
    assert not known.holds_for(images[0], 1.1 * scene.radius)
    assert not known.holds_for(replace(images[0], labels=~images[0].mask), scene.radius)
