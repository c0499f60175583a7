"""Images made of clouds."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.synthetic import Camera, Segmentation, scene
from strand.views.cloud_images import close_holes, draw_cloud, draw_ropes, fill_thinned
from strand.views.depth_image import DepthImage

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


@pytest.mark.parametrize("share", [0.8, 0.6, 0.4])
def test_gaps_of_thinned_clouds_are_filled_by_depths_beside_them(share):
    rng = np.random.default_rng(3)
    true = np.zeros((60, 80))
    true[5:55, 5:75] = 1.0
    true[25:35, 5:75] = 0.9
    kept = (true > 0) & (rng.random(true.shape) < share)
    image = DepthImage(np.where(kept, true, 0.0), VIEW.image.camera, np.eye(4))
    filled = fill_thinned(image).depth
    assert np.array_equal(filled[kept], true[kept])
    assert np.mean(filled[true > 0] > 0) > 0.75
    # one pixel of noise at edges, no depth between the surfaces
    assert set(np.unique(filled)) == {0.0, 0.9, 1.0}
    low, high = (np.isin(np.arange(60), rows) for rows in ([*range(8, 22), *range(38, 52)], range(28, 32)))
    assert np.all(filled[low][:, 8:72][filled[low][:, 8:72] > 0] == 1.0)
    assert np.all(filled[high][:, 8:72][filled[high][:, 8:72] > 0] == 0.9)
    assert not filled[[*range(3), *range(57, 60)]].any()


def test_full_clouds_and_their_gaps_stay_as_they_are():
    image = draw_cloud(strand.View(VIEW.points, VIEW.pose))
    assert fill_thinned(image) is image
    depth = np.ones((40, 40))
    depth[10:20, 10:20] = 0.0
    shadowed = DepthImage(depth, VIEW.image.camera, np.eye(4))
    assert fill_thinned(shadowed) is shadowed
