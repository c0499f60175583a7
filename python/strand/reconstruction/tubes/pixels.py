"""Find the pixel of each point, by the views' images or by the regular spacing of rays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strand.geometry.lengths import measure_lengths
from strand.support.checks import Array
from strand.views.view import View

_NOISE_POINTS = 5000  # points, at least, whose noise is measured
_MIN_COSINE = 0.2  # between a ray and the optical axis: rays with less do not come from that camera
_MIN_NEIGHBORS = 0.5  # share of points with a neighbour to their right where pixels are dense
_PITCHES = (1e-4, 0.1)  # tangents: distances of pixels that are searched
_STEPS = 8  # bisections of that range
_SAMPLE = 1000  # points that are searched
_ROUNDING = 1e-6  # tangents: smaller differences come from rounding
_MAX_PIXELS = 1 << 24  # of an image
_COLUMN_STRIDE = 2.0**26  # by which the number of a pixel grows from column to column


@dataclass(frozen=True, eq=False)
class Grid:
    """The pixels of some points.

    Attributes
    ----------
    column, row : (N,) ndarray of int64
        Numbers from 0.
    depth : (N,) ndarray
        Depth along the optical axis, metres.
    focal : float
        Focal length, pixels.
    axes : (3, 3) ndarray
        Right, down and forward of the camera, in the frame of the points.
    """

    column: NDArray[np.int64]
    row: NDArray[np.int64]
    depth: Array
    focal: float
    axes: Array

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return int(self.column.max()) + 1, int(self.row.max()) + 1


@dataclass(frozen=True, eq=False)
class Cameras:
    """The cameras that took the points of a fit.

    Attributes
    ----------
    views : sequence of View
        Views with the points of the fit, in its order; each has some.
    whole : sequence of View
        The same views with all their points.
    """

    views: Sequence[View]
    whole: Sequence[View]

    @cached_property
    def grids(self) -> dict[int, Grid]:
        """The pixels of the points of some views, enough to measure their noise.

        Views whose points cannot come from an image are skipped.
        """
        grids: dict[int, Grid] = {}
        counts = [len(view.points) for view in self.views]
        some = min(math.ceil(_NOISE_POINTS * len(counts) / sum(counts)), len(counts))
        for number in np.linspace(0, len(counts) - 1, some).round().astype(np.int64).tolist():
            image = self.whole[number].image
            like = next(iter(grids.values())).focal if grids else None
            grid = _make_grid(self.views[number].points, None if image is None else image.camera.focal, like)
            if grid is not None:
                grids[number] = grid
        return grids

    def have_grids(self, views: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Tell which of (N,) views have a grid."""
        return np.array([number in self.grids for number in range(len(self.views))])[views]

    def make_images(self) -> list[tuple[Array, float]]:
        """Return (H, W) depths of these cameras and the median depth of the fit's points, metres.

        Where a view has no image, one is made of its points.
        """
        images = []
        for number, grid in self.grids.items():
            whole = self.whole[number]
            if whole.image is not None:
                images.append((whole.image.depth, float(np.median(grid.depth))))
                continue
            points = whole.points @ grid.axes.T
            seen = _make_grid(points[_are_in_front(points)], (grid.focal, grid.focal), None)
            if seen is not None:
                depth = np.zeros(seen.size[::-1])
                depth[seen.row, seen.column] = seen.depth
                images.append((depth, float(np.median(grid.depth))))
        return images


def _are_in_front(points: Array) -> NDArray[np.bool_]:
    """Tell for each point whether it is in front of a camera that looks along z."""
    return np.asarray(points[:, 2] > _MIN_COSINE * measure_lengths(points))


def _make_grid(points: Array, focal: tuple[float, float] | None, like: float | None) -> Grid | None:
    """Assign pixels to points, for a focal length or one that makes pixels dense; None if no camera fits."""
    axes = np.eye(3)
    if not _are_in_front(points).all():
        axes = _orient_camera(points)
        points = points @ axes.T
        if not _are_in_front(points).all():
            return None
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if focal is None:
        focal = (1.0 / _find_pitch(x, y, like),) * 2
    column, row = np.rint((x - x[0]) * focal[0]), np.rint((y - y[0]) * focal[1])
    column, row = column - column.min(), row - row.min()
    if (column.max() + 1.0) * (row.max() + 1.0) > _MAX_PIXELS:
        return None
    return Grid(column.astype(np.int64), row.astype(np.int64), points[:, 2], focal[0], axes)


def _orient_camera(points: Array) -> Array:
    """Return (3, 3) right, down and forward of a camera at the origin that looks at points."""
    forward = points.mean(axis=0)
    forward = forward / max(float(np.linalg.norm(forward)), np.finfo(float).tiny)
    right = np.cross(np.eye(3)[np.abs(forward).argmin()], forward)
    right = right / max(float(np.linalg.norm(right)), np.finfo(float).tiny)
    return np.stack([right, np.cross(forward, right), forward])


def _find_pitch(x: Array, y: Array, like: float | None) -> float:
    """Return the distance of pixels, a tangent, at which most points have a neighbour."""
    # neighbouring columns with all their points
    some = np.argsort(x, kind="stable")[:_SAMPLE]
    x, y = x[some], y[some]

    def is_dense(pitch: float) -> bool:
        cells = np.sort(np.rint((x - x[0]) / pitch) * _COLUMN_STRIDE + np.rint((y - y[0]) / pitch))
        right = np.searchsorted(cells, cells + _COLUMN_STRIDE).clip(0, len(cells) - 1)
        return bool((cells[right] == cells + _COLUMN_STRIDE).mean() > _MIN_NEIGHBORS)

    # rows of a complete image are one pixel from each other
    gaps = np.diff(np.sort(y))
    rows = gaps[gaps > _ROUNDING]
    for pitch in ([float(np.median(rows))] if len(rows) else []) + ([] if like is None else [1.0 / like]):
        if _PITCHES[0] <= pitch <= _PITCHES[1] and is_dense(pitch):
            return pitch
    low, high = _PITCHES
    for _ in range(_STEPS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if is_dense(middle) else (middle, high)
    return high
