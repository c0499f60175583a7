"""Which pixel saw which point: from the views' images, or from how regularly the rays to points lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array
from strand.views.view import View

# points of so many pixels are enough to know their noise
_ENOUGH = 5000
# rays more aslant to the optical axis, as a cosine, are none of a camera that looks along it
_LEAST_COSINE = 0.2
# share of the points that have a neighbour to their right where pixels are dense
_NEIGHBOURS = 0.5
# distances of pixels that are looked for, as tangents, in so many steps, on so many points
_PITCHES, _STEPS, _SAMPLE = (1e-4, 0.1), 8, 1000
# differences that rounding makes, as tangents
_ROUNDING = 1e-6
# cameras take no images with more pixels
_MOST_PIXELS = 1 << 24


@dataclass(frozen=True, eq=False)
class Grid:
    """The pixels of some points.

    Attributes
    ----------
    column, row : (N,) ndarray of int64
        From 0.
    depth : (N,) ndarray
        Along the optical axis, metres.
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
    """What took the points of a fit.

    Attributes
    ----------
    views : sequence of View
        Their points are those of the fit, in its order; none is without.
    whole : sequence of View
        The same views with all that they saw.
    """

    views: Sequence[View]
    whole: Sequence[View]

    @cached_property
    def grids(self) -> dict[int, Grid]:
        """The pixels of some views' points, spread over all and with points enough to know their noise.

        Without views whose points no camera can have taken as an image.
        """
        grids: dict[int, Grid] = {}
        counts = [len(view.points) for view in self.views]
        some = min(math.ceil(_ENOUGH * len(counts) / sum(counts)), len(counts))
        for number in np.linspace(0, len(counts) - 1, some).round().astype(np.int64).tolist():
            image = self.whole[number].image
            like = next(iter(grids.values())).focal if grids else None
            grid = _grid(self.views[number].points, None if image is None else image.camera.focal, like)
            if grid is not None:
                grids[number] = grid
        return grids

    def images(self) -> list[tuple[Array, float]]:
        """Return (H, W) depths of all that these cameras saw, re-made where they came as points.

        Each with the median depth of the view's points, metres.
        """
        images = []
        for number, grid in self.grids.items():
            whole = self.whole[number]
            if whole.image is not None:
                images.append((whole.image.depth, float(np.median(grid.depth))))
                continue
            points = whole.points @ grid.axes.T
            seen = _grid(points[_before(points)], (grid.focal, grid.focal), None)
            if seen is not None:
                depth = np.zeros(seen.size[::-1])
                depth[seen.row, seen.column] = seen.depth
                images.append((depth, float(np.median(grid.depth))))
        return images


def _before(points: Array) -> NDArray[np.bool_]:
    """Whether points lie before a camera that looks along z."""
    return np.asarray(points[:, 2] > _LEAST_COSINE * np.sqrt((points * points).sum(axis=1)))


def _grid(points: Array, focal: tuple[float, float] | None, like: float | None) -> Grid | None:
    """Give points pixels: of a camera of a focal length, without that of one in which pixels are dense."""
    axes = np.eye(3)
    if not _before(points).all():
        axes = _looking_at(points)
        points = points @ axes.T
        if not _before(points).all():
            return None
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    if focal is None:
        focal = (1.0 / _pitch(x, y, like),) * 2
    column, row = np.rint((x - x[0]) * focal[0]), np.rint((y - y[0]) * focal[1])
    column, row = column - column.min(), row - row.min()
    if (column.max() + 1.0) * (row.max() + 1.0) > _MOST_PIXELS:
        return None
    return Grid(column.astype(np.int64), row.astype(np.int64), points[:, 2], focal[0], axes)


def _looking_at(points: Array) -> Array:
    """(3, 3) Right, down and forward of a camera at the origin that looks at points."""
    forward = points.mean(axis=0)
    forward = forward / max(float(np.linalg.norm(forward)), np.finfo(float).tiny)
    right = np.cross(np.eye(3)[np.abs(forward).argmin()], forward)
    right = right / max(float(np.linalg.norm(right)), np.finfo(float).tiny)
    return np.stack([right, np.cross(forward, right), forward])


def _pitch(x: Array, y: Array, like: float | None) -> float:
    """Distance of pixels, as a tangent, where most points have a neighbour."""
    # a piece of the image with all its points
    some = np.argsort(x, kind="stable")[:_SAMPLE]
    x, y = x[some], y[some]

    def dense(pitch: float) -> bool:
        # numbers of pixels, of those in the next column by 2^26 more
        cells = np.sort(np.rint((x - x[0]) / pitch) * 2.0**26 + np.rint((y - y[0]) / pitch))
        right = np.searchsorted(cells, cells + 2.0**26).clip(0, len(cells) - 1)
        return bool((cells[right] == cells + 2.0**26).mean() > _NEIGHBOURS)

    # rows of an image that was taken as it is are one pixel apart
    gaps = np.diff(np.sort(y))
    rows = gaps[gaps > _ROUNDING]
    for pitch in ([float(np.median(rows))] if len(rows) else []) + ([] if like is None else [1.0 / like]):
        if _PITCHES[0] <= pitch <= _PITCHES[1] and dense(pitch):
            return pitch
    low, high = _PITCHES
    for _ in range(_STEPS):
        middle = (low * high) ** 0.5
        low, high = (low, middle) if dense(middle) else (middle, high)
    return high
