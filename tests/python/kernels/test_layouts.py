"""Points that pile up or lie far apart cost no more than others, and give the same answers."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import strand

COUNT = 100_000
# where time grows with the square of the points these take minutes
SECONDS = 8.0


def sheet(seed: int, count: int = COUNT) -> np.ndarray:
    """Points of a wavy sheet, about eight within 0.005 of each."""
    x, y = np.random.default_rng(seed).random((2, count))
    return np.column_stack([x, y, 0.1 * np.sin(5.0 * x) + 0.5])


def one_place() -> np.ndarray:
    return np.tile([0.5, 0.25, 2.0], (COUNT, 1))


def invalid_pixels() -> np.ndarray:
    points = sheet(1)
    points[::2] = 0.0
    return points


def far_outlier() -> np.ndarray:
    points = sheet(2)
    points[17] = 1e7
    return points


def far_clusters() -> np.ndarray:
    points = sheet(3)
    points[::2, 0] += 1e7
    return points


LAYOUTS = {layout.__name__: layout for layout in (one_place, invalid_pixels, far_outlier, far_clusters)}


@pytest.mark.parametrize("name", LAYOUTS)
def test_no_layout_takes_long(name):
    points, above = LAYOUTS[name](), [0.0, 0.0, 9.0]
    normals = np.tile([0.0, 0.0, 1.0], (COUNT, 1))
    start = time.process_time()
    counts = strand.count_neighbors(points, 0.005)
    strand.radius_outlier_mask(points, 0.005, 4)
    strand.estimate_normals(points, k=12, viewpoint=above)
    found = strand.estimate_normals(points, radius=0.005, viewpoint=above)
    axis, rows = strand.centerline(points, normals, 0.0025, 3)
    strand.icp(points[: COUNT // 4], points, 0.01, max_iterations=2)
    strand.trace_chains(points, 0.05, 0.1)
    assert time.process_time() - start < SECONDS
    # some against brute force
    for i in range(0, COUNT, COUNT // 40 + 1):
        near = np.flatnonzero(((points - points[i]) ** 2).sum(axis=1) <= 0.005**2)
        assert counts[i] == len(near) - 1
        row = np.searchsorted(rows, i)
        assert (row < len(rows) and rows[row] == i) == (len(near) >= 3)
        if len(near) >= 3:
            assert_allclose(axis[row], (points[near] - 0.0025 * normals[near]).mean(axis=0), rtol=1e-11)
            values, vectors = np.linalg.eigh(np.cov(points[near].T))
            if values[1] > 1e-6 * values[2] > 0.0:
                assert abs(found[i] @ vectors[:, 0]) > 1.0 - 1e-9
            elif values[2] == 0.0:
                assert_array_equal(found[i], 0.0)


@pytest.mark.parametrize(
    ("scale", "offset", "radius"),
    [
        (1e-3, 1e8, 1e-9),
        (3e-4, 1e12, 6e-5),
        (4e-9, 1.4e7, 2.9e-9),
        (1.0, 1e10, 1e-10),
        (1e12, 0.0, 1e-9),
        (1e-9, 0.0, 1e9),
    ],
)
def test_scales_that_coordinates_hardly_tell_apart_are_answered(scale, offset, radius):
    rng = np.random.default_rng(5)
    for _ in range(40):
        points = scale * rng.random((60, 3)) + offset * rng.choice([-1.0, 1.0], 3)
        points[:20] = points[rng.integers(0, 60, 20)]
        apart = points[:, None] - points
        squared = apart[..., 0] ** 2 + apart[..., 1] ** 2 + apart[..., 2] ** 2
        assert_array_equal(strand.count_neighbors(points, radius), (squared <= radius**2).sum(axis=1) - 1)
