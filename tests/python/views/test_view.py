"""Views: what a camera saw, and where it stood."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import strand
from strand import View
from strand.views.depth_image import DepthImage
from strand.views.view import masked

INTRINSICS = np.array([[200.0, 0.0, 31.5], [0.0, 210.0, 23.5], [0.0, 0.0, 1.0]])


def random_pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return strand.pose_from_angles(*rng.uniform(-3, 3, 3), rng.uniform(-2, 2, 3))


def test_from_depth_inverts_the_projection():
    pose = random_pose(0)
    depth = np.random.default_rng(1).uniform(0.2, 0.8, (48, 64))
    depth[3, 5] = 0.0
    view = View.from_depth(depth, INTRINSICS, pose)
    assert len(view.points) == depth.size - 1
    image = view.points @ INTRINSICS.T
    u, v = image[:, 0] / image[:, 2], image[:, 1] / image[:, 2]
    columns, rows = np.rint(u).astype(int), np.rint(v).astype(int)
    np.testing.assert_allclose(u, columns, atol=1e-9)
    np.testing.assert_allclose(v, rows, atol=1e-9)
    np.testing.assert_allclose(view.points[:, 2], depth[rows, columns], rtol=0, atol=0)
    back = (view.world_points - view.viewpoint) @ pose[:3, :3]
    np.testing.assert_allclose(back, view.points, atol=1e-12)


def test_pixels_without_a_return_are_dropped_and_the_broken_ones_counted():
    depth = np.full((4, 5), 0.5, dtype=np.float32)
    depth[0, 0], depth[1, 1], depth[2, 2], depth[3, 3] = 0.0, np.nan, np.inf, -np.inf
    view = View.from_depth(depth, INTRINSICS)
    assert len(view.points) == 16
    assert view.dropped == 3
    np.testing.assert_array_equal(view.image.depth, np.where(np.eye(4, 5) > 0, 0.0, 0.5))


def test_a_depth_image_is_copied_and_cropping_it_is_cropping_its_points():
    depth = np.random.default_rng(3).uniform(0.2, 0.8, (48, 64))
    depth[5, 6], depth[7, 8] = 0.0, np.nan
    pose = random_pose(4)
    view, seen = (View.from_depth(depth, INTRINSICS, pose) for _ in range(2))
    depth[:] = 0.5
    points = View(seen.points, pose)
    centre = seen.world_points.mean(axis=0)
    bounds = (centre - 0.1, centre + np.array([0.1, 0.2, np.inf]))
    want = points.crop(bounds).points
    assert 0 < len(want) < len(points.points)
    copied = pickle.loads(pickle.dumps(view))
    for image in (view, seen, copied):
        np.testing.assert_array_equal(image.crop(bounds).points, want)
        assert image.crop(bounds).dropped == 1
    np.testing.assert_array_equal(view.points, points.points)
    with pytest.raises(AttributeError, match="nothing"):
        _ = copied.nothing


@pytest.mark.parametrize("kind", [np.uint16, np.int32, np.float32, np.float64])
def test_a_depth_scale_says_what_a_unit_is(kind):
    millimetres = np.random.default_rng(6).integers(0, 900, (12, 16)).astype(kind)
    assert (millimetres == 0).sum() + 1 < millimetres.size
    view = View.from_depth(millimetres, INTRINSICS, depth_scale=0.001)
    want = View.from_depth(millimetres.astype(float) * 0.001, INTRINSICS)
    np.testing.assert_array_equal(view.points, want.points)
    assert view.dropped == 0
    whole_metres = View.from_depth(np.full((12, 16), 2, dtype=kind), INTRINSICS, depth_scale=1)
    assert (whole_metres.points[:, 2] == 2.0).all()


def test_broken_pixels_are_counted_whatever_the_unit():
    depth = np.full((3, 4), 500.0)
    depth[0, 0], depth[1, 1], depth[2, 2] = 0.0, np.nan, np.inf
    view = View.from_depth(depth, INTRINSICS, depth_scale=0.001)
    assert (len(view.points), view.dropped) == (9, 2)
    np.testing.assert_allclose(view.points[:, 2], 0.5)


@pytest.mark.parametrize(
    ("depth", "scale", "error", "message"),
    [
        (
            np.ones((3, 4), np.uint16),
            None,
            TypeError,
            "depth: .*metres, got dtype uint16; depth_scale= gives",
        ),
        (np.ones((3, 4), int).tolist(), None, TypeError, "depth: .* 0.001 for millimetres"),
        (np.ones((3, 4), bool), 0.001, TypeError, "depth: expected numbers, got dtype bool"),
        (np.full((3, 4), -1), 0.001, ValueError, "depth: expected depths >= 0"),
        (np.ones((3, 4), np.uint16), 0.0, ValueError, "depth_scale: expected a positive"),
        (np.ones((3, 4), np.uint16), np.nan, ValueError, "depth_scale: expected a positive"),
        (np.ones((3, 4), np.uint16), "mm", TypeError, "depth_scale: expected a number"),
        (np.ones((3, 4, 1), np.uint16), 0.001, ValueError, r"depth: expected shape \(H, W\)"),
    ],
)
def test_depths_whose_unit_is_not_known_are_refused(depth, scale, error, message):
    with pytest.raises(error, match=message):
        View.from_depth(depth, INTRINSICS, depth_scale=scale)


@pytest.mark.parametrize("written", [np.asarray, np.ndarray.tolist], ids=["arrays", "lists"])
def test_vectors_and_matrices_may_be_whole_numbers(written):
    points = np.random.default_rng(7).uniform(-1.0, 1.0, (20, 3))
    points[:, 2] += 2.0
    depth = np.full((3, 4), 2.0)
    turn = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    camera = np.array([[200, 0, 31], [0, 210, 23], [0, 0, 1]])
    viewpoint, low, high = np.array([1, 2, 3]), np.array([0, 0, 1]), np.array([1, 1, 2])
    for make in (
        lambda like: View(points, like(turn)).world_points,
        lambda like: View.from_depth(depth, like(camera), like(turn)).world_points,
        lambda like: View.from_world(points, like(viewpoint)).points,
        lambda like: View(points).crop((like(low), like(high))).points,
    ):
        given = make(written)
        assert given.size
        np.testing.assert_array_equal(given, make(np.float64))


def test_what_a_view_holds_cannot_be_assigned():
    view = View(np.ones((4, 3)))
    names = ("points", "pose", "dropped", "colors", "image", "mask", "measured", "viewpoint", "world_points")
    for name in (*names, "colours"):
        with pytest.raises(AttributeError, match=name):
            setattr(view, name, None)
    np.testing.assert_array_equal(view.points, np.ones((4, 3)))


def test_a_view_shows_what_it_is_in_one_line_and_makes_no_points_for_that():
    view = View.from_depth(np.ones((12, 16)), INTRINSICS)
    assert repr(view) == "View(depth image of 16 x 12 pixels, camera at [0.0, 0.0, 0.0] m)"
    assert isinstance(view.measured, DepthImage)
    assert view.measured is view.image
    assert view.points.shape == (192, 3)
    assert repr(view) == "View(192 points, camera at [0.0, 0.0, 0.0] m)"
    assert view.measured is view.points


def test_parts_and_moved_views_keep_what_belongs_to_the_points():
    rng = np.random.default_rng(8)
    points, colors = rng.normal(size=(20, 3)), rng.uniform(size=(20, 3))
    view = View(points, random_pose(9), dropped=3, colors=colors)
    chosen = rng.random(20) < 0.5
    some = view.select(chosen)
    np.testing.assert_array_equal(some.points, points[chosen])
    np.testing.assert_array_equal(some.colors, colors[chosen])
    np.testing.assert_array_equal(some.pose, view.pose)
    motion = random_pose(10)
    moved = view.moved(motion)
    want = view.world_points @ motion[:3, :3].T + motion[:3, 3]
    np.testing.assert_allclose(moved.world_points, want, atol=1e-12)
    assert moved.points is view.points
    assert (some.dropped, moved.dropped) == (3, 3)


def test_what_the_caller_does_with_its_pose_later_changes_no_view():
    for made in (
        lambda pose: View(np.ones((4, 3)), pose),
        lambda pose: View.from_depth(np.ones((3, 4)), INTRINSICS, pose),
    ):
        pose = np.eye(4)
        view = made(pose)
        pose[0, 3] = 5.0
        assert view.pose[0, 3] == 0.0


def test_depths_whose_points_are_not_finite_are_refused():
    far = np.ones((3, 4))
    far[1, 2] = 1e308
    with pytest.raises(ValueError, match=r"depth.*finite"):
        View.from_depth(far, np.array([[1e-3, 0.0, 1.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]]))
    with pytest.raises(ValueError, match=r"depth.*finite"):
        View.from_depth(np.ones((3, 4)), np.array([[1.0, 0.0, 1.5], [0.0, 1e-310, 1.0], [0.0, 0.0, 1.0]]))
    far[1, 2] = np.inf
    assert View.from_depth(far, INTRINSICS).dropped == 1
    assert len(View.from_depth(np.zeros((0, 4)), INTRINSICS).points) == 0


def test_from_world_keeps_the_points_and_the_camera():
    points = np.random.default_rng(2).normal(size=(20, 3))
    view = View.from_world(points, viewpoint=[1.0, -2.0, 3.0])
    np.testing.assert_allclose(view.world_points, points, atol=1e-15)
    np.testing.assert_array_equal(view.viewpoint, [1.0, -2.0, 3.0])


def test_crop_keeps_the_faces_of_the_box_and_everything_inside():
    points = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0], [1.5, 1.5, 1.5], [2.1, 1.5, 1.5], [1.5, 1.5, 0.9]])
    kept = View(points).crop(([1.0, 1.0, 1.0], [2.0, 2.0, 2.0]))
    np.testing.assert_array_equal(kept.points, points[:3])
    moved = View(points, random_pose(3))
    low, high = moved.world_points.min(axis=0) - 1e-9, moved.world_points.max(axis=0) + 1e-9
    assert len(moved.crop((low, high)).points) == 5
    high[1] = np.inf
    assert len(moved.crop((low, high)).points) == 5


@pytest.mark.parametrize("layout", ["fortran", "strided", "float32", "big endian"])
def test_any_layout_and_float_type_is_read_right(layout):
    points = np.random.default_rng(5).normal(size=(30, 3)).astype(np.float32).astype(np.float64)
    variants = {
        "fortran": np.asfortranarray(points),
        "strided": np.repeat(points, 2, axis=0)[::2],
        "float32": points.astype(np.float32),
        "big endian": points.astype(">f8"),
    }
    view = View(variants[layout])
    np.testing.assert_array_equal(view.points, points)
    assert view.points.flags.c_contiguous
    assert view.points.dtype == np.float64


def spoiled(row: int, column: int, value: float) -> np.ndarray:
    pose = np.eye(4)
    pose[row, column] = value
    return pose


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: View(np.zeros((3, 2))), ValueError, r"points: expected shape \(N, 3\), got \(3, 2\)"),
        (lambda: View(np.zeros((3, 3), dtype=int)), TypeError, "points: expected floating point"),
        (lambda: View(np.array([[None] * 3])), TypeError, "points"),
        (lambda: View(np.full((2, 3), np.nan)), ValueError, "points: expected finite"),
        (lambda: View(np.zeros((2, 3)), np.eye(3)), ValueError, "pose"),
        (lambda: View(np.zeros((2, 3)), spoiled(0, 0, -1.0)), ValueError, "pose: expected a rigid motion"),
        (lambda: View(np.zeros((2, 3)), spoiled(0, 0, 1.01)), ValueError, "pose: expected a rigid motion"),
        (lambda: View(np.zeros((2, 3)), spoiled(3, 0, 0.5)), ValueError, "pose: expected the last row"),
        (lambda: View(np.zeros((2, 3)), spoiled(0, 3, np.inf)), ValueError, "pose"),
        (lambda: View.from_depth(np.zeros((4, 4, 1)), INTRINSICS), ValueError, "depth"),
        (lambda: View.from_depth(np.zeros((4, 4), dtype=np.uint16), INTRINSICS), TypeError, "depth"),
        (lambda: View.from_depth(-np.ones((4, 4)), INTRINSICS), ValueError, "depth: expected depths >= 0"),
        (lambda: View.from_depth(np.ones((4, 4)), np.eye(3) * -1), ValueError, "intrinsics"),
        (lambda: View.from_depth(np.ones((4, 4)), np.eye(4)), ValueError, "intrinsics"),
        (lambda: View.from_world(np.zeros((2, 3)), [0.0, 1.0]), ValueError, "viewpoint"),
        (lambda: View(np.zeros((2, 3))).crop(([0.0] * 3, [0.0, 1.0, 1.0])), ValueError, "bounds"),
        (lambda: View(np.zeros((2, 3))).crop([0.0] * 3), ValueError, "bounds"),
    ],
)
def test_wrong_input_is_refused_by_name(make, error, message):
    with pytest.raises(error, match=message):
        make()


K = np.array([[300.0, 0, 3.0], [0, 300.0, 2.0], [0, 0, 1.0]])


def test_a_depth_image_brings_the_colours_of_its_pixels():
    depth = np.zeros((4, 6))
    depth[1, 2], depth[3, 5], depth[0, 0] = 0.5, 0.6, np.nan
    colors = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    view = View.from_depth(depth, K, colors=colors)
    np.testing.assert_array_equal(view.colors, colors[[1, 3], [2, 5]] / 255.0)
    np.testing.assert_array_equal(View.from_depth(depth, K, colors=colors / 255.0).colors, view.colors)
    cropped = view.crop(([-1.0, -1.0, 0.55], [1.0, 1.0, 1.0]))
    np.testing.assert_array_equal(cropped.colors, view.colors[1:])
    assert cropped.dropped == 1
    assert View.from_depth(depth, K).colors is None


def test_colours_belong_to_the_view():
    points, colors = np.zeros((2, 3)), np.full((2, 3), 0.5)
    view = View(points, colors=colors)
    colors[:] = 0.0
    assert (view.colors == 0.5).all()
    world = View.from_world(points, [0.0, 0.0, 1.0], np.full((2, 3), 255, dtype=np.uint8))
    assert (world.colors == 1.0).all()


@pytest.mark.parametrize(
    ("colors", "error", "message"),
    [
        (np.zeros((3, 3)), ValueError, r"colors: expected shape \(2, 3\)"),
        (np.zeros((2, 4)), ValueError, r"colors: expected shape \(2, 3\)"),
        (np.full((2, 3), 1.5), ValueError, "colors: expected colours from 0 to 1"),
        (np.full((2, 3), -0.5), ValueError, "colors: expected colours from 0 to 1"),
        (np.full((2, 3), np.nan), ValueError, "colors: expected finite"),
        (np.zeros((2, 3), dtype=np.int64), TypeError, "colors: expected uint8, or floats"),
    ],
)
def test_wrong_colours_are_refused(colors, error, message):
    with pytest.raises(error, match=message):
        View(np.zeros((2, 3)), colors=colors)


@pytest.mark.parametrize("wrong", [None, 1, [], [0, 1, 1], [True, False]])
def test_points_are_chosen_by_one_bool_each(wrong):
    view = View(np.ones((3, 3)))
    with pytest.raises(ValueError, match="chosen: expected one bool for each of 3 points"):
        view.select(wrong)
    assert len(view.select(np.array([True, False, True])).points) == 2


def test_only_a_rigid_motion_moves_a_view():
    view = View(np.ones((3, 3)))
    with pytest.raises(ValueError, match="motion: expected a rigid motion"):
        view.moved(2.0 * np.eye(4) - np.diag([0.0, 0.0, 0.0, 1.0]))


def test_depths_that_overflow_in_metres_are_refused():
    with pytest.raises(ValueError, match="depth: expected depths that are finite in metres"):
        View.from_depth(np.full((3, 3), 1e308), np.eye(3), depth_scale=1e10)


def masked_image():
    """A depth image with holes, its colours, and a mask with holes inside and returns outside."""
    rng = np.random.default_rng(11)
    depth, colors = rng.uniform(0.2, 0.8, (48, 64)), rng.uniform(size=(48, 64, 3))
    mask = rng.random((48, 64)) < 0.3
    depth[rng.random((48, 64)) < 0.1] = 0.0
    depth[0, 0], mask[0, 0] = np.nan, True
    return depth, colors, mask


def test_the_points_of_a_masked_view_are_those_inside_and_all_else_was_seen():
    depth, _, mask = masked_image()
    pose = random_pose(12)
    view = View.from_depth(depth, INTRINSICS, pose, mask=mask)
    inside = View.from_depth(np.where(mask, depth, 0.0), INTRINSICS, pose)
    np.testing.assert_array_equal(view.points, inside.points)
    assert 0 < len(view.points) < mask.sum()  # rope pixels without depth stay in the mask
    # also after somebody has asked for the points
    assert view.measured is view.image
    np.testing.assert_array_equal(view.image.depth, np.where(np.isnan(depth), 0.0, depth))
    np.testing.assert_array_equal(view.mask, mask)
    np.testing.assert_array_equal(view.image.labels, mask.astype(np.int32))
    assert repr(view).startswith("View(depth image of 64 x 48 pixels, masked, camera at")
    centre = view.world_points.mean(axis=0)
    bounds = (centre - 0.1, centre + 0.1)
    fresh = View.from_depth(depth, INTRINSICS, pose, mask=mask)
    want = View(inside.points, pose).crop(bounds).points
    assert 0 < len(want) < len(view.points)
    for whole in (view, fresh, pickle.loads(pickle.dumps(fresh))):
        part = whole.crop(bounds)
        np.testing.assert_array_equal(part.points, want)
        assert part.mask is None
        assert whole.mask is not None
    moved = fresh.moved(random_pose(13))
    np.testing.assert_array_equal(moved.mask, mask)
    np.testing.assert_array_equal(moved.points, inside.points)
    some = fresh.select(np.arange(len(fresh.points)) % 2 == 0)
    np.testing.assert_array_equal(some.points, inside.points[::2])


def test_a_masked_view_has_the_colours_of_its_points():
    depth, colors, mask = masked_image()
    view = View.from_depth(depth, INTRINSICS, colors=colors, mask=mask)
    np.testing.assert_array_equal(view.colors, colors[mask & (depth > 0)])
    assert len(view.colors) == len(view.points)
    centre = view.points.mean(axis=0)
    part = view.crop((centre - 0.1, centre + 0.1))
    inside = (np.abs(view.points - centre) <= 0.1).all(axis=1)
    assert 0 < inside.sum() < len(inside)
    np.testing.assert_array_equal(part.colors, view.colors[inside])


@pytest.mark.parametrize("coloured", [False, True])
def test_a_view_that_is_masked_later_is_as_if_its_mask_had_come_with_it(coloured):
    depth, colors, mask = masked_image()
    colors = colors if coloured else None
    whole = View.from_depth(depth, INTRINSICS, random_pose(3), colors)
    later = masked(whole, dataclasses.replace(whole.image, labels=mask))
    view = View.from_depth(depth, INTRINSICS, random_pose(3), colors, mask=mask)
    assert 0 < len(view.points) < len(whole.points)
    for name in ("points", "pose", "dropped", "colors", "mask", "world_points"):
        np.testing.assert_array_equal(getattr(later, name), getattr(view, name), strict=True)


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.int64, ">i4", list])
def test_labels_are_kept_as_they_are_given(kind):
    depth, _, mask = masked_image()
    labels = np.where(mask, 1 + np.arange(64) % 200, 0)
    given = labels.tolist() if kind is list else np.asfortranarray(labels.astype(kind))
    view = View.from_depth(depth, INTRINSICS, mask=given)
    np.testing.assert_array_equal(view.image.labels, labels)
    assert view.image.labels.dtype == np.int32
    assert view.image.labels.flags.c_contiguous
    np.testing.assert_array_equal(view.mask, mask)


def test_what_the_caller_does_with_its_mask_later_changes_no_view():
    for mask in (np.ones((3, 4), dtype=bool), np.ones((3, 4), dtype=np.int32)):
        view = View.from_depth(np.ones((3, 4)), INTRINSICS, mask=mask)
        mask[:] = 0
        assert view.mask.all()
        assert len(view.points) == 12


@pytest.mark.parametrize(
    ("mask", "error", "message"),
    [
        (
            np.ones((4, 3), dtype=bool),
            ValueError,
            r"mask: expected the depth image's shape \(3, 4\), got \(4, 3\)",
        ),
        (np.ones((3, 4, 3), dtype=np.uint8), ValueError, r"mask: .*got \(3, 4, 3\)"),
        (np.ones(12, dtype=bool), ValueError, "mask: expected the depth image's shape"),
        (np.ones((3, 4)), TypeError, "mask: expected bools, or whole numbers .* got dtype float64"),
        (np.full((3, 4), None), TypeError, "mask: .*got dtype object"),
        ("mask.png", TypeError, "mask: expected bools"),
        ([[True], [True, False]], ValueError, "mask: "),
        (np.full((3, 4), -1), ValueError, "mask: expected labels from 0 to 2147483647, got -1 to -1"),
        (np.full((3, 4), 2**31), ValueError, "mask: expected labels from 0"),
    ],
)
def test_a_mask_of_another_shape_or_kind_is_refused(mask, error, message):
    with pytest.raises(error, match=message):
        View.from_depth(np.ones((3, 4)), INTRINSICS, mask=mask)


def test_a_view_without_a_mask_has_none():
    view = View.from_depth(np.ones((3, 4)), INTRINSICS)
    assert view.mask is None
    assert view.image.labels is None
    assert View(np.ones((4, 3))).mask is None


def test_points_where_the_camera_is_are_no_returns():
    points = np.arange(30.0).reshape(10, 3)
    points[[0, 4, 7]] = 0.0, -0.0, 0.0
    colors = np.linspace(0.0, 1.0, 30).reshape(10, 3)
    view = View(points, colors=colors)
    there = points.any(axis=1)
    np.testing.assert_array_equal(view.points, points[there])
    np.testing.assert_array_equal(view.colors, colors[there])
    assert len(view.points) == 7
    assert view.dropped == 0
    with pytest.raises(ValueError, match="colors"):
        View(points, colors=colors[there])
    # a coordinate of zero is a place
    assert len(View(np.eye(3)).points) == 3
    assert len(View(np.zeros((5, 3))).points) == 0
    world = View.from_world(points, [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(world.points, points[there])
    assert len(View.from_world(points, [0.5, 0.0, 0.0]).points) == 10
