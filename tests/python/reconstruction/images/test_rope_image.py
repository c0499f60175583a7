"""Images of ropes: as they were given, cropped, or made of points; the table; poses that are corrected."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.geometry.polyline import between
from strand.reconstruction.images.image_nodes import corrected_poses
from strand.reconstruction.images.rope_image import prepared, rope_images
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.synthetic import Segmentation, scene
from strand.views.view import cropped

SCENE = scene("loop", seed=2, views=3, camera="zed", mask=Segmentation(), size=(320, 240))


def pixels_of(image, view):
    """Columns, rows and depth of a view's points in an image."""
    to_camera = np.linalg.inv(image.pose)
    x, y, z = (view.world_points @ to_camera[:3, :3].T + to_camera[:3, 3]).T
    (fx, fy), (cx, cy) = image.focal, image.centre
    return fx * x / z + cx, fy * y / z + cy, z


def test_a_masked_image_is_as_it_was_given():
    views = SCENE.views
    for image, view, mask in zip(rope_images(views, views, None), views, SCENE.mask, strict=True):
        assert np.array_equal(image.mask, mask)
        assert image.depth is view.image.depth
        u, v, z = pixels_of(image, view)
        rows, columns = np.nonzero(mask & (image.depth > 0))
        assert u == pytest.approx(columns, abs=1e-6)
        assert v == pytest.approx(rows, abs=1e-6)
        assert z == pytest.approx(image.depth[rows, columns])


def test_pixels_are_where_their_points_of_the_world_are_seen():
    image = rope_images(SCENE.views, SCENE.views, None)[0]
    rows, columns = np.mgrid[:5, :7] * 30
    z = np.random.default_rng(1).uniform(0.2, 2.0, rows.shape)
    world = image.world(rows, columns, z)
    back = np.linalg.inv(image.pose)
    assert world @ back[2, :3] + back[2, 3] == pytest.approx(z)
    seen = np.column_stack([columns.ravel(), rows.ravel()])
    assert image.projected(world.reshape(-1, 3)) == pytest.approx(seen, abs=1e-9)
    flat = image.world(rows.ravel(), columns.ravel(), z.ravel())
    assert flat.reshape(world.shape) == pytest.approx(world)


def test_depth_out_of_the_extraction_range_is_not_in_the_mask_and_pixels_without_depth_are():
    views = SCENE.views
    low, high = SCENE.bounds
    box = strand.Box(low, [SCENE.truth[0][:, 0].mean(), high[1], high[2]])
    for image, view in zip(rope_images(cropped(views, box), views, box), views, strict=True):
        seen = image.depth > 0
        assert np.array_equal(image.mask[~seen], view.mask[~seen])
        left = int(np.count_nonzero(image.mask & seen))
        inside = ((view.world_points >= box.low) & (view.world_points <= box.high)).all(axis=1)
        assert left == np.count_nonzero(inside)
        assert 0 < left < len(inside)


def test_depths_of_nearly_nothing_have_a_pixel_too():
    depth = SCENE.depth[0] * SCENE.depth_scale
    depth[::9, ::7] = 5e-324
    views = [strand.View.from_depth(depth, SCENE.intrinsics, SCENE.poses[0])]
    (image,) = rope_images(views, views, None)
    assert image.mask[depth > 0.1].all()


def test_an_image_without_a_mask_has_the_pixels_of_its_points():
    whole = dataclasses.replace(SCENE, mask=None).views
    low, high = SCENE.bounds
    box = strand.Box([low[0], low[1], 0.003], high)
    views = cropped(whole, box)
    for image, view, all_seen in zip(rope_images(views, whole, box), views, whole, strict=True):
        assert image.depth is all_seen.image.depth
        assert np.count_nonzero(image.mask) == len(view.points) > 100
        u, v, _ = pixels_of(image, view)
        assert image.mask[np.rint(v).astype(int), np.rint(u).astype(int)].all()


@pytest.mark.parametrize("from_world", [False, True])
def test_points_alone_make_an_image_that_shows_them_to_a_pixel(from_world):
    views = [
        strand.View.from_world(view.world_points, view.pose[:3, 3])
        if from_world
        else strand.View(view.points, view.pose)
        for view in SCENE.views
    ]
    images = rope_images(views, views, None)
    for image, view in zip(images, views, strict=True):
        u, v, z = pixels_of(image, view)
        assert z.min() > 0
        rows, columns = np.rint(v).astype(int), np.rint(u).astype(int)
        near = np.zeros(image.mask.shape, dtype=bool)
        near[rows, columns] = True
        assert np.array_equal(near, image.mask)
        # the nearest of the points in a pixel
        assert (image.depth[rows, columns] <= z + 1e-9).all()
        assert np.mean(np.abs(image.depth[rows, columns] - z) < 1e-9) > 0.7
        turn = image.pose[:3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert len(prepared(images, SCENE.radius).radii) == 3


def test_the_table_is_found_where_it_is_and_nowhere_else():
    images = rope_images(SCENE.views, SCENE.views, None)
    normal, offset = find_table_beside_ropes(images[1], SCENE.radius)
    assert np.linalg.norm(normal) == pytest.approx(1.0)
    assert normal[2] > np.cos(0.03)
    centre = SCENE.truth[0].mean(axis=0)
    assert abs(normal @ [centre[0], centre[1], 0.0] - offset) < 0.5 * SCENE.radius
    bare = [dataclasses.replace(image, depth=np.where(image.mask, image.depth, 0.0)) for image in images]
    assert find_table_beside_ropes(bare[1], SCENE.radius) is None
    rng = np.random.default_rng(0)
    rough = [
        dataclasses.replace(
            image, depth=np.where(image.mask, image.depth, rng.uniform(0.2, 2.0, image.depth.shape))
        )
        for image in images
    ]
    assert find_table_beside_ropes(rough[1], SCENE.radius) is None


def test_corrections_of_frames_move_points_as_they_say():
    rng = np.random.default_rng(3)
    poses = [pose for pose in SCENE.poses]
    corrections = rng.normal(scale=[[0.02] * 3 + [0.003] * 3], size=(3, 6))
    corrections[1] = 0.0
    points = rng.normal(size=(50, 3))
    corrected = corrected_poses(poses, corrections)
    assert np.array_equal(corrected[1], poses[1])
    for pose, after, (*turn, x, y, z) in zip(poses, corrected, corrections, strict=True):
        assert after[:3, :3] @ after[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
        before = (points - pose[:3, 3]) @ pose[:3, :3]
        now = (points - after[:3, 3]) @ after[:3, :3]
        # to first order; the second is half the square of the angle
        first = before + np.cross(turn, before) + [x, y, z]
        assert np.abs(now - first).max() <= np.linalg.norm(turn) ** 2 * np.abs(before).max() + 1e-12


def test_covariances_between_nodes_are_linear_and_at_nodes_their_own():
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(5, 3, 3))
    values = roots @ roots.transpose(0, 2, 1)
    known = np.linspace(0.0, 1.0, 5)
    assert between(known, known, values) == pytest.approx(values)
    assert between(np.array([0.125]), known, values)[0] == pytest.approx(0.5 * (values[0] + values[1]))
    found = between(rng.uniform(size=100), known, values)
    assert (np.linalg.eigvalsh(found) > 0).all()


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"masks": []}, "masks"),
        ({"poses": []}, "poses"),
        ({"cameras": []}, "cameras"),
        ({"masks": [np.ones((5, 6), dtype=bool)]}, "masks"),
        ({"masks": [np.zeros((40, 50), dtype=bool)]}, "masks"),
        ({"depths": [np.zeros((40, 50))]}, "masks"),
        ({"depths": [np.full((40, 50), 1e300)]}, "masks"),
        ({"depths": [np.ones(50)]}, "depths"),
        ({"poses": [np.ones((4, 4))]}, "poses"),
    ],
)
def test_wrong_images_are_refused(change, named):
    arguments = {
        "depths": [np.ones((40, 50))],
        "masks": [np.ones((40, 50), dtype=bool)],
        "cameras": [((50.0, 50.0), (24.5, 19.5))],
        "poses": [np.eye(4)],
    }
    with pytest.raises(ValueError, match=f"^{named}"):
        strand._core.RopeImages(**{**arguments, **change}, radius=0.05)


def test_views_and_polylines_that_are_none_are_refused():
    image = prepared(rope_images(SCENE.views, SCENE.views, None), SCENE.radius)
    line = np.array([[100.0, 100.0], [150.0, 120.0]])
    with pytest.raises(ValueError, match="no view 3"):
        image.reading_cost(3, [line])
    with pytest.raises(ValueError, match="no view 7"):
        image.fit([(7, [line])], None, 1, (0.01, 0.01), (None, 3.0, 0.3, 0.0), 2, False)
    for wrong in (line[:1], np.ones((4, 3))):
        with pytest.raises(ValueError, match=r"\(M, 2\)"):
            image.fit([(0, [wrong])], None, 1, (0.01, 0.01), (None, 3.0, 0.3, 0.0), 2, False)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({0: [(0, [np.array([[0.0, 0.0], [1e300, 0.0]])])]}, "hypotheses"),
        ({0: [(0, [np.array([[0.0, 0.0], [np.nan, 0.0]])])]}, "hypotheses"),
        ({0: [(0, [np.tile([[0.0, 0.0], [9e4, 0.0]], (2, 1))])]}, "hypotheses"),
        ({1: ((0.0, 0.0, 9.0), 0.5)}, "plane"),
        ({1: ((0.0, 0.0, 1.0), np.inf)}, "plane"),
        ({3: (0.0, 0.01)}, "pose_sd"),
        ({4: (None, 3.0, np.nan, 0.0)}, "errors"),
        ({4: (None, 3.0, 0.3, np.inf)}, "errors"),
        ({5: 10**9}, "iterations"),
    ],
)
def test_fits_of_mad_numbers_are_refused(change, named):
    images = prepared(rope_images(SCENE.views, SCENE.views, None), SCENE.radius)
    line = np.array([[100.0, 100.0], [150.0, 120.0]])
    given = [[(0, [line])], None, 1, (0.01, 0.01), (None, 3.0, 0.3, 0.0), 2, False]
    for place, value in change.items():
        given[place] = value
    with pytest.raises(ValueError, match=f"^{named}"):
        images.fit(*given)


def test_readings_whose_depth_jumps_to_and_fro_are_no_ropes():
    mask = np.zeros((96, 256), bool)
    mask[44:52, 20:236] = True
    depth = np.where(mask, 0.49, 0.5)
    camera, errors = ((400.0, 400.0), (128.0, 48.0)), (None, 4.0, 0.5, 0.0)
    table, sd = ((0.0, 0.0, -1.0), -0.5), (0.01, 0.01)

    def fitted(depth):
        images = strand._core.RopeImages([depth], [mask], [camera], [np.eye(4)], 0.005)
        readings = images.readings(1, 2, [0])
        return images.fit([(0, chains) for _, _, chains, _ in readings], table, 0, sd, errors, 5, False)

    assert fitted(depth)[0] is not None
    far = mask & (np.arange(256) // 24 % 2 == 1)
    assert set(fitted(np.where(far, 2.0, depth))) == {None}
