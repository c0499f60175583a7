"""Images made of clouds."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.synthetic import Camera, Segmentation, scene
from strand.views.cloud_images import close_holes, draw_cloud, draw_ropes

SCENE = scene("loop", seed=2, views=1, camera=Camera("zed"), mask=Segmentation())
VIEW = SCENE.views[0]


def test_a_cloud_is_drawn_as_the_image_that_it_was():
    image = draw_cloud(strand.View(VIEW.points, VIEW.pose))
    assert image.camera.focal == pytest.approx(VIEW.image.camera.focal)
    assert image.pose == pytest.approx(VIEW.pose)
    rows, columns = np.nonzero(image.mask)
    given_rows, given_columns = np.nonzero(VIEW.mask & (VIEW.image.depth > 0))
    assert np.array_equal(rows - rows.min(), given_rows - given_rows.min())
    assert np.array_equal(columns - columns.min(), given_columns - given_columns.min())
    assert image.depth[rows, columns] == pytest.approx(VIEW.image.depth[given_rows, given_columns])


def test_a_cloud_of_the_world_is_drawn_where_its_camera_stood():
    view = strand.View.from_world(VIEW.world_points, VIEW.viewpoint)
    image, measured = draw_ropes(view, view)
    assert measured
    assert np.abs(image.pose[:3, 2] @ VIEW.pose[:3, 2]) == pytest.approx(1.0, abs=1e-6)
    rows, columns = np.nonzero(image.depth)
    points = image.lift(rows, columns, image.depth[rows, columns])
    order, given = (np.lexsort(np.round(one, 6).T) for one in (points, VIEW.world_points))
    assert points[order] == pytest.approx(VIEW.world_points[given], abs=1e-5)


def test_holes_between_pixels_are_closed_and_gaps_between_strands_are_not():
    strands = np.zeros((60, 80), dtype=bool)
    strands[10:20, 10:70] = strands[24:34, 10:70] = True
    holes = np.random.default_rng(2).random(strands.shape) < 0.35
    closed = close_holes(strands & ~holes)
    inside = np.zeros_like(strands)
    inside[12:18, 12:68] = inside[26:32, 12:68] = True
    assert np.mean(closed[inside]) > 0.97
    assert not closed[21:23].any()
    assert not closed[~strands].any()


def test_surroundings_are_drawn_and_not_marked():
    depth, camera = VIEW.image.depth, VIEW.image.camera
    rows, columns = np.nonzero(depth)
    whole = strand.View(camera.lift(rows, columns, depth[rows, columns]), VIEW.pose)
    image, _ = draw_ropes(strand.View(VIEW.points, VIEW.pose), whole)
    assert np.count_nonzero(image.mask) == len(VIEW.points)
    assert np.count_nonzero(image.depth) > 2 * len(VIEW.points)
