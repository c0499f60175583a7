"""Usual mistakes in what is handed over are named, and views that are right are not suspected."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.mistakes.agreement import measure_view_distance
from strand.reconstruction.mistakes.diagnosis import explain_errors, find_mistakes
from strand.reconstruction.mistakes.field_of_view import (
    doubt_far_depths,
    doubt_points_all_around,
    doubt_principal_point,
    doubt_shared_viewpoint,
)
from strand.reconstruction.mistakes.flatness import doubt_bent_tables, measure_table
from strand.reconstruction.mistakes.undo import MISTAKES, measure_ray_lengths
from strand.reconstruction.radius import Radii
from strand.views.extract import Extract, extract_views

SCENE = strand.synthetic.scene("paper", seed=2, views=3, noise=strand.synthetic.Noise(depth=0.5e-3))
BOUNDS = strand.Box(*SCENE.bounds)
DEPTH = SCENE.depth * SCENE.depth_scale
K = SCENE.intrinsics
POSES = SCENE.poses
R = SCENE.radius


def images(depth=DEPTH, intrinsics=K, poses=POSES):
    return [strand.View.from_depth(d, intrinsics, p) for d, p in zip(depth, poses, strict=True)]


def in_millimetres(poses):
    found = poses.copy()
    found[:, :3, 3] *= 1e3
    return found


def on_axes(turn):
    found = POSES.copy()
    found[:, :3, :3] = found[:, :3, :3] @ turn
    return found


LARGER = K * [[2.0], [2.0], [1.0]]
RAYS = np.stack([measure_ray_lengths(view.image) for view in images()])
MADE = {
    "poses look like world-to-camera ones": images(poses=np.linalg.inv(POSES)),
    "each view seems to have that of the view before it": images(poses=np.roll(POSES, 1, axis=0)),
    "each view seems to have that of the view after it": images(poses=np.roll(POSES, -1, axis=0)),
    "the poses' translations look like millimetres": images(poses=in_millimetres(POSES)),
    "depths look like millimetres": images(1e3 * DEPTH),
    "depth looks mirrored, left to right": images(DEPTH[:, :, ::-1]),
    "depth looks upside down": images(DEPTH[:, ::-1]),
    "depth looks turned by half a turn": images(DEPTH[:, ::-1, ::-1]),
    "depth looks transposed": images(DEPTH.transpose(0, 2, 1)),
    "the camera frame looks like x right, y up": images(poses=on_axes(np.diag([1.0, -1.0, -1.0]))),
    "intrinsics look like those of an image of another size": images(intrinsics=LARGER),
    "depth looks as if it was measured along the rays": images(DEPTH * RAYS),
    "points look like world-frame ones": [strand.View(v.world_points, v.pose) for v in images()],
}


def crop(views):
    return tuple(view.crop(BOUNDS) for view in views)


def name_mistakes(views, ropes, bounds):
    inside = tuple(ropes) if bounds is None else crop(ropes)
    return find_mistakes(Extract(tuple(views), bounds, inside), R, ropes)


def test_views_that_are_right_are_not_suspected():
    assert name_mistakes(images(), images(), BOUNDS) == []
    assert name_mistakes(images()[:1], images()[:1], BOUNDS) == []


@pytest.mark.parametrize("name", MADE)
def test_a_mistake_is_named_first_of_all(name):
    views = MADE[name]
    first, *_ = name_mistakes(views, views, BOUNDS)
    assert name in first.reason
    assert first.amount > 4.0


def test_a_mistake_undone_gives_views_that_agree_and_what_was_given_back():
    before = measure_view_distance(images(), crop(images()), 10.0 * R)
    assert before < 0.6 * R
    by_words = {mistake.advice.split(":")[0]: mistake for mistake in MISTAKES}
    views = by_words["poses look like world-to-camera ones"].undo(images(poses=np.linalg.inv(POSES)))
    assert measure_view_distance(views, crop(views), 10.0 * R) == pytest.approx(before, rel=1e-6)
    np.testing.assert_allclose([view.pose for view in views], POSES, atol=1e-12)
    (back,) = by_words["depth looks transposed, rows for columns"].undo(images(DEPTH.transpose(0, 2, 1))[:1])
    np.testing.assert_array_equal(back.image.depth, DEPTH[0])


def test_the_answer_has_the_doubt_and_says_by_how_much_views_disagree():
    model = strand.reconstruct(MADE["depth looks mirrored, left to right"], R, SCENE.bounds)
    doubt = model.doubts[0]
    assert doubt.kind == "depth"
    assert "give depth[:, ::-1]; views disagree by" in doubt.reason
    assert model.confidence < 0.1


def test_views_that_disagree_for_no_usual_reason_are_doubted():
    poses = POSES.copy()
    poses[0, :3, 3] += [0.1, 0.0, 0.0]
    poses[2, :3, 3] -= [0.0, 0.09, 0.0]
    views = images(poses=poses)
    (doubt,) = name_mistakes(views, views, BOUNDS)
    assert doubt.kind == "pose"
    assert "of angles in radians" in doubt.reason
    # a little is left to the registration
    poses = POSES.copy()
    poses[0, :3, 3] += [0.004, 0.0, 0.0]
    assert name_mistakes(images(poses=poses), images(poses=poses), BOUNDS) == []


def test_views_of_different_places_do_not_disagree_but_are_doubted():
    far = strand.synthetic.scene("arc", seed=1, views=1, radius=R)
    pose = far.poses[0].copy()
    pose[:3, 3] += [5.0, 0.0, 0.0]
    views = [images()[1], strand.View.from_depth(far.depth[0] * far.depth_scale, far.intrinsics, pose)]
    ropes = strand.find_ropes(views, R).views
    assert np.isinf(measure_view_distance(ropes, ropes, 10.0 * R))
    # that is unusual
    (doubt,) = name_mistakes(views, ropes, None)
    assert doubt.reason.startswith("no view shows the ropes of another; are poses camera-to-world")
    assert 0.5 < doubt.amount < 1.0
    assert np.isnan(measure_view_distance(ropes[:1], ropes[:1], 10.0 * R))
    assert name_mistakes(views[:1], ropes[:1], None) == []


def test_a_table_is_flat_in_the_depth_that_it_was_seen_in():
    for views in (images(), [strand.View(view.points, view.pose) for view in images()]):
        as_given, divided = measure_table(views[0])
        assert as_given < 0.1 * divided
        assert doubt_bent_tables(views) is None
    bent = images(DEPTH * RAYS)
    as_given, divided = measure_table(bent[0])
    assert divided < 0.1 * as_given
    doubt = doubt_bent_tables(bent)
    assert f"{1e3 * as_given:.1f}"[:2] in doubt.reason
    # where no plane is seen, or ropes alone, nothing is said
    assert measure_table(bent[0].crop(SCENE.bounds)) is None
    wavy = 0.4 + 0.1 * np.sin(np.arange(320) / 9.0) * np.ones((240, 1))
    assert measure_table(strand.View.from_depth(wavy, K)) is None


@pytest.mark.parametrize("camera", ["tof", "zed", "d405"])
def test_errors_of_cameras_bend_no_table(camera):
    made = strand.synthetic.scene("s", seed=4, views=1, camera=strand.synthetic.Camera(camera))
    assert doubt_bent_tables(made.views) is None


def test_points_all_around_their_camera_are_doubted():
    (view, *_) = images()
    assert doubt_points_all_around([strand.View(view.points, view.pose)]) is None
    assert doubt_points_all_around([view]) is None
    inside = strand.View.from_world(view.world_points, view.world_points.mean(axis=0))
    doubt = doubt_points_all_around([strand.View(view.points), inside])
    assert doubt.kind == "viewpoint"
    assert "view 1 lie all around" in doubt.reason


def test_views_from_one_place_that_look_elsewhere_are_doubted():
    made = strand.synthetic.scene("arc", views=3)
    doubt = doubt_shared_viewpoint([strand.View(view.world_points + 0.3) for view in made.views])
    assert doubt.kind == "viewpoint"
    assert "views 0, 1 and 2 have one pose" in doubt.reason
    # one camera that stays, another one, and two ropes apart, are right
    points, noise = made.views[0].points, np.random.default_rng(0).normal(scale=1e-3, size=(2, 320 * 240, 3))
    still = [strand.View(points + more[: len(points)]) for more in noise]
    ropes = [strand.View(part) for part in np.array_split(made.views[0].crop(made.bounds).points, 2)]
    assert doubt_shared_viewpoint([*still, strand.View(made.views[1].points, made.poses[1]), *ropes]) is None


def test_a_principal_point_of_another_image_is_doubted():
    assert doubt_principal_point(images()) is None
    assert "transposed" in doubt_principal_point(MADE["depth looks transposed"]).reason
    larger = doubt_principal_point(images(intrinsics=LARGER)).reason
    assert "an image 2 times as large: the principal point (319, 239) is the middle of" in larger
    # an image that was cut out of another
    cut = K - [[0.0, 0.0, 60.0], [0.0, 0.0, 10.0], [0.0, 0.0, 0.0]]
    assert doubt_principal_point(images(DEPTH[:, 10:200, 60:300], cut)) is None


def test_a_principal_point_of_another_usual_size_is_doubted():
    intrinsics = np.array([[848.0, 0.0, 643.2], [0.0, 848.0, 357.1], [0.0, 0.0, 1.0]])
    view = strand.View.from_depth(np.full((480, 640), 0.5), intrinsics)
    assert "an image of 1280 x 720" in doubt_principal_point([view]).reason
    # the same image, cut out of a larger one
    assert doubt_principal_point([strand.View.from_depth(np.full((470, 640), 0.5), intrinsics)]) is None


def test_a_rope_of_unknown_radius_cannot_be_seen_from_too_far():
    far = images(1e3 * DEPTH)
    assert "depth_scale=0.001" in doubt_far_depths(far, 1e3 * R, K[0, 0]).reason
    assert doubt_far_depths(images(20.0 * DEPTH), 20.0 * R, K[0, 0]) is None


def test_a_rope_cannot_be_seen_from_too_far():
    assert doubt_far_depths(images(), R) is None
    assert doubt_far_depths(images(1e3 * DEPTH), 1e3 * R) is None
    assert "depth_scale=0.001" in doubt_far_depths(images(1e3 * DEPTH), R).reason


def test_points_of_a_world_in_millimetres_are_too_far_too():
    view = strand.View.from_world(1e3 * images()[0].world_points, 1e3 * POSES[0, :3, 3])
    # a camera above the table looks down: z is negative
    assert np.median(view.points[:, 2]) < 0
    assert "millimetres" in doubt_far_depths([view], R).reason


def test_views_of_different_places_from_opposite_sides_do_not_show_one_rope():
    """As angles in degrees make them: directions are any."""
    points = SCENE.truth[0] + np.random.default_rng(0).normal(scale=R / 2, size=SCENE.truth[0].shape)
    middle, up = points.mean(axis=0), np.array([0.0, 0.0, 0.5])
    one = strand.View.from_world(points, middle + up)
    same, elsewhere = (strand.View.from_world(points + d, middle + d - up) for d in (0.0, [3.0, 0.0, 0.0]))
    assert measure_view_distance([one, same], [one, same], 10.0 * R) == 0.0
    assert not measure_view_distance([one, elsewhere], [one, elsewhere], 10.0 * R) < R


@pytest.mark.parametrize("height", [0.05, 0.1])
def test_an_empty_table_in_bounds_is_no_mistake(height):
    far = [np.array([[5.0, 5.0, R], [5.1, 5.0, R]])]
    rng = np.random.default_rng(0)
    depth = [strand.synthetic.render_depth(far, R, K, pose) for pose in POSES]
    views = images([np.where(d > 0, d + rng.normal(0.0, 0.3e-3, d.shape), 0.0) for d in depth])
    for radius in (None, R):
        with pytest.raises(strand.NoRopeError) as refused:
            strand.reconstruct(views, radius, bounds=([-0.15, -0.15, -0.05], [0.15, 0.15, height]))
        for blamed in ("along the rays", "poses", "look like", "in radius"):
            assert blamed not in str(refused.value)
        assert "bounds that exclude the table" in str(refused.value)


def test_an_error_says_the_radius_that_ropes_look_like():
    with (
        pytest.raises(strand.NoRopeError) as caught,
        explain_errors(extract_views(images(), BOUNDS), Radii.from_caller(2.0 * R)),
    ):
        raise strand.NoRopeError("views: nothing")
    said = str(caught.value)
    assert said.startswith("views: nothing; the ropes look ")
    assert said.endswith(f"mm in radius, {2e3 * R:.1f} mm was given")
    looks = float(said.split("the ropes look ")[1].split(" mm")[0])
    assert looks == pytest.approx(1e3 * R, rel=0.1)
    with (
        pytest.raises(strand.NotEnoughDataError) as caught,
        explain_errors(extract_views(images(), BOUNDS), Radii.from_caller(R)),
    ):
        raise strand.NotEnoughDataError("views: nothing")
    assert str(caught.value) == "views: nothing"


def test_an_error_names_the_mistake():
    views = MADE["depth looks mirrored, left to right"]
    named = pytest.raises(strand.NotEnoughDataError, match="nothing; depth looks mirrored")
    with named, explain_errors(extract_views(views, BOUNDS), None):
        raise strand.NotEnoughDataError("views: nothing")
