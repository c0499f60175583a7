"""Images of ropes: as they were given, cropped, or made of points."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.reconstruction.images.prepare import prepare_images
from strand.synthetic import Camera, Segmentation, scene
from strand.views.rope_images import make_rope_images
from strand.views.view import cropped

SCENE = scene("loop", seed=2, views=3, camera=Camera("zed"), mask=Segmentation())


def pixels_of(image, view):
    """Columns, rows and depth of a view's points in an image."""
    to_camera = np.linalg.inv(image.pose)
    x, y, z = (view.world_points @ to_camera[:3, :3].T + to_camera[:3, 3]).T
    (fx, fy), (cx, cy) = image.camera
    return fx * x / z + cx, fy * y / z + cy, z


def test_a_masked_image_is_as_it_was_given():
    views = SCENE.views
    for image, view, mask in zip(make_rope_images(views, views, None), views, SCENE.mask, strict=True):
        assert np.array_equal(image.mask, mask)
        assert image.depth is view.image.depth
        u, v, z = pixels_of(image, view)
        rows, columns = np.nonzero(mask & (image.depth > 0))
        assert u == pytest.approx(columns, abs=1e-6)
        assert v == pytest.approx(rows, abs=1e-6)
        assert z == pytest.approx(image.depth[rows, columns])


def test_pixels_are_where_their_points_of_the_world_are_seen():
    image = make_rope_images(SCENE.views, SCENE.views, None)[0]
    rows, columns = np.mgrid[:5, :7] * 30
    z = np.random.default_rng(1).uniform(0.2, 2.0, rows.shape)
    world = image.lift(rows, columns, z)
    back = np.linalg.inv(image.pose)
    assert world @ back[2, :3] + back[2, 3] == pytest.approx(z)
    seen = np.column_stack([columns.ravel(), rows.ravel()])
    assert image.project(world.reshape(-1, 3)) == pytest.approx(seen, abs=1e-9)
    flat = image.lift(rows.ravel(), columns.ravel(), z.ravel())
    assert flat.reshape(world.shape) == pytest.approx(world)


def test_depth_out_of_the_extraction_range_is_not_in_the_mask_and_pixels_without_depth_are():
    views = SCENE.views
    low, high = SCENE.bounds
    box = strand.Box(low, [SCENE.truth[0][:, 0].mean(), high[1], high[2]])
    for image, view in zip(make_rope_images(cropped(views, box), views, box), views, strict=True):
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
    (image,) = make_rope_images(views, views, None)
    assert image.mask[depth > 0.1].all()


def test_an_image_without_a_mask_has_the_pixels_of_its_points():
    whole = dataclasses.replace(SCENE, mask=None).views
    low, high = SCENE.bounds
    box = strand.Box([low[0], low[1], 0.003], high)
    views = cropped(whole, box)
    for image, view, all_seen in zip(make_rope_images(views, whole, box), views, whole, strict=True):
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
    images = make_rope_images(views, views, None)
    for image, view in zip(images, views, strict=True):
        u, v, z = pixels_of(image, view)
        assert z.min() > 0
        rows, columns = np.rint(v).astype(int), np.rint(u).astype(int)
        near = np.zeros(image.mask.shape, dtype=bool)
        near[rows, columns] = True
        # holes between points are closed
        assert image.mask[near].all()
        assert np.count_nonzero(image.mask) < 1.1 * np.count_nonzero(near)
        # the nearest of the points in a pixel
        assert (image.depth[rows, columns] <= z + 1e-9).all()
        assert np.mean(np.abs(image.depth[rows, columns] - z) < 1e-9) > 0.7
        turn = image.pose[:3, :3]
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)
    assert len(prepare_images(images, SCENE.radius).radii) == 3
