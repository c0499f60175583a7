"""The grid of pixels that a cloud was measured in."""

from __future__ import annotations

import numpy as np
import pytest

from strand.synthetic import Camera, scene
from strand.views.pixel_grid import find_pixel_grid
from strand.views.pose import make_rotation

SCENE = scene("figure8", seed=3, views=1, camera=Camera("zed"))
POINTS = SCENE.views[0].points
CAMERA = SCENE.views[0].image.camera
TURN = make_rotation(np.array([0.6, -0.64, 0.48]), 2.1)


def shuffled(points, share):
    """A share of points in random order."""
    chosen = np.random.default_rng(4).permutation(len(points))[: int(share * len(points))]
    return points[chosen]


@pytest.mark.parametrize(
    ("points", "turn"),
    [
        (POINTS, np.eye(3)),
        (POINTS * [1.0, -1.0, -1.0], np.diag([1.0, -1.0, -1.0])),
        (POINTS @ TURN, TURN.T),
        (shuffled(POINTS, 1.0), np.eye(3)),
        (shuffled(POINTS @ TURN, 0.6), TURN.T),
        (POINTS.astype(np.float32).astype(float), np.eye(3)),
        (np.round(POINTS, 4), np.eye(3)),
    ],
    ids=["as it is", "OpenGL", "turned", "shuffled", "thinned and turned", "float32", "rounded to 0.1 mm"],
)
def test_the_camera_of_a_cloud_is_found(points, turn):
    grid = find_pixel_grid(points)
    assert grid is not None
    assert grid.camera.focal == pytest.approx(CAMERA.focal, rel=1e-3)
    columns, rows = np.rint(grid.camera.project(points @ grid.turn)).T
    # no two points share a pixel
    assert len(np.unique(rows * 1e5 + columns)) == len(points)
    assert grid.turn[:, 2] == pytest.approx(turn[:, 2], abs=1e-6)
    if np.count_nonzero(turn) == 3:
        # a turned camera's columns may be taken for rows
        assert np.array_equal(grid.turn, turn)


def test_points_that_were_averaged_or_drawn_at_random_are_on_no_grid():
    cells, place = np.unique(np.floor(POINTS / 0.002), axis=0, return_inverse=True)
    counts = np.bincount(place.ravel())
    means = [np.bincount(place.ravel(), POINTS[:, k]) / counts for k in range(3)]
    assert find_pixel_grid(np.column_stack(means)) is None
    drawn = np.random.default_rng(1).uniform(-0.2, 0.2, (3000, 3))
    drawn[:, 2] += 0.7
    assert find_pixel_grid(drawn) is None
    assert 500 < len(cells) < len(POINTS)


def test_few_points_and_a_tenth_of_all_pixels_are_on_no_grid():
    assert find_pixel_grid(POINTS[:20]) is None
    # a finer image than its points would be full of holes
    assert find_pixel_grid(shuffled(POINTS, 0.1)) is None
