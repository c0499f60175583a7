"""The pinhole camera: pixels, points and rays agree."""

from __future__ import annotations

import numpy as np
import pytest

from strand.views.pinhole import Pinhole

CAMERA = Pinhole((400.0, 380.0), (31.0, 22.5))


def test_a_matrix_is_a_camera():
    matrix = np.array([[400.0, 0.0, 31.0], [0.0, 380.0, 22.5], [0.0, 0.0, 1.0]])
    assert Pinhole.from_matrix(matrix) == CAMERA


def test_points_are_seen_where_pixels_show_them():
    rows, columns = np.indices((5, 7)) * 9
    z = np.random.default_rng(1).uniform(0.2, 2.0, rows.shape)
    points = CAMERA.lift(rows, columns, z)
    seen = CAMERA.project(points.reshape(-1, 3))
    assert seen == pytest.approx(np.column_stack([columns.ravel(), rows.ravel()]), abs=1e-9)
    assert CAMERA.cast_rays(rows, columns) * z[..., None] == pytest.approx(points)


def test_squares_of_pixels_look_where_their_middle_does():
    ray = CAMERA.cast_rays(np.array([4.0]), np.array([7.0]))
    # the middle of the square of rows 3 to 5 and columns 6 to 8 of the fine image
    assert CAMERA.averaged(3).cast_rays(np.array([1.0]), np.array([2.0])) == pytest.approx(ray)
