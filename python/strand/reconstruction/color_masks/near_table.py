"""Where depth shows a table, and how high pieces of strips stand above it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.color_masks.color_pieces import Mask, Piece
from strand.reconstruction.images.table_plane import find_largest_plane
from strand.support.checks import Array
from strand.support.robust import estimate_deviation
from strand.views.depth_image import list_pixels
from strand.views.pinhole import Pinhole

_MAX_POINTS = 8_000  # points that the plane is sought in
_NEAR_PLANE = 0.01  # of the plane's distance: heights this small give its scatter
_MIN_SEEN = 0.1  # of the pixels have depth; with fewer, depth shows chosen things rather than a table
_DEVIATIONS = 3.0  # scatters: pixels this near to the plane show it
_MIN_HEIGHT = 0.004  # metres: pixels nearer than this show it as well
_REACH = 20  # pixels around a pixel that show the table
_EACH = 4  # rows: every fourth one gives the scatter; and every fourth pixel the shares of the table
_MIN_SHARE = 0.3  # of the pixels around that show the table, beside one that may show a rope
_SHOWN = 4.0  # scatters of heights: depth shows ropes that are thicker
_HIGH = 6.0  # radii, and 4 scatters: ropes pile up no higher
_WIDE = 1.35  # half widths: what is high and wider is a thing
_EDGE = 2.0  # pixels that things are grown by
_MIN_THING = 50  # pixels of a thing
_FLAT = 0.3  # radii: what is lower lies in the table


@dataclass(frozen=True, eq=False)
class NearTable:
    """The table in a depth image.

    Attributes
    ----------
    plane : Plane
        In the camera frame.
    near : (H, W) ndarray of bool
        Pixels with table around.
    heights : (H, W) ndarray
        Above the table, metres; NaN without depth.
    scatter : float
        Standard deviation of the table's heights, metres; infinite where little depth shows no table.
    depth : (H, W) ndarray
        Metres; 0 for no return.
    focal : float
        Focal length, pixels.
    """

    plane: Plane
    near: Mask
    heights: Array
    scatter: float
    depth: Array
    focal: float

    def cut(self, window: tuple[slice, slice]) -> NearTable:
        """Return the table in rows and columns of the image."""
        near, heights, depth = self.near[window], self.heights[window], self.depth[window]
        return replace(self, near=near, heights=heights, depth=depth)

    def measure_radius(self, pieces: list[Piece]) -> float | None:
        """Return the median radius of pieces, metres, weighted by length; None without depth."""
        radii, weights = [], []
        for piece in pieces:
            z = self.depth[piece.samples]
            z = z[z > 0]
            if len(z):
                radii.append(piece.half_width * float(np.median(z)) / self.focal)
                weights.append(piece.length)
        if not radii:
            return None
        order = np.argsort(radii)
        total = np.cumsum(np.asarray(weights)[order])
        return float(radii[order[int(np.searchsorted(total, 0.5 * total[-1]))]])

    def shows_flat(self, piece: Piece) -> bool:
        """Tell whether a piece lies in the table although depth could show its height."""
        radius = self.measure_radius([piece])
        heights = self.heights[piece.samples]
        seen = heights[np.isfinite(heights)]
        if radius is None or 2.0 * radius <= _SHOWN * self.scatter or 2 * len(seen) <= len(heights):
            return False
        return float(np.median(seen)) < _FLAT * radius

    def find_things(self, radius: float, half_width: float) -> Mask | None:
        """Return the pixels of things that are wider and higher than ropes; None without any.

        The ropes have a radius, metres, and a half width, pixels.
        """
        if not math.isfinite(self.scatter):
            return None
        with np.errstate(invalid="ignore"):
            high = np.asarray(self.heights > _HIGH * radius + _SHOWN * self.scatter)
        if np.count_nonzero(high) < _MIN_THING:
            return None
        reach = _WIDE * half_width
        core = np.asarray(_core.measure_edge_distances(high, int(reach) + 2) - 0.5 > reach)
        if not core.any():
            return None
        reach += _EDGE + 0.5
        return np.asarray(_core.measure_edge_distances(~core, int(reach) + 2) < reach)


def find_near_table(depth: Array, camera: Pinhole) -> NearTable | None:
    """Find the plane that most depth shows, and the pixels near it; None without a plane."""
    seen = depth > 0
    rows, columns = select_seen(depth, _MAX_POINTS)
    found = find_largest_plane(camera.lift(rows, columns, depth[rows, columns]))
    if found is None:
        return None
    plane, _ = found
    # along rows and columns, rays change evenly
    height, width = depth.shape
    across = camera.cast_rays(np.zeros(width), np.arange(width)) @ plane.normal
    down = camera.cast_rays(np.arange(height), np.zeros(height)) @ plane.normal
    heights = (across + (down - across[0])[:, None]) * depth - plane.offset
    heights[~seen] = np.nan
    away = np.abs(heights)
    if np.count_nonzero(seen) < _MIN_SEEN * seen.size:
        near = np.asarray(_core.measure_edge_distances(~seen, _REACH + 1) <= _REACH)
        return NearTable(plane, near, heights, math.inf, depth, camera.focal[0])
    few = heights[::_EACH]
    scatter = estimate_deviation(few[np.abs(few) < -_NEAR_PLANE * plane.offset])
    flat = away < max(_DEVIATIONS * scatter, _MIN_HEIGHT)
    shares = average(flat[::_EACH, ::_EACH].astype(np.float32), _REACH // _EACH) > _MIN_SHARE
    near = shares.repeat(_EACH, axis=0).repeat(_EACH, axis=1)[: depth.shape[0], : depth.shape[1]]
    return NearTable(plane, near, heights, scatter, depth, camera.focal[0])


def select_seen(depth: Array, most: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return rows and columns of about so many pixels with depth, spread evenly over an image."""
    step = max(int(math.sqrt(depth.size / most)), 1)
    rows, columns = list_pixels(depth[::step, ::step] > 0)
    if 4 * len(rows) >= most:
        return rows * step, columns * step
    rows, columns = list_pixels(depth > 0)
    each = max(len(rows) // most, 1)
    return rows[::each], columns[::each]


def average(values: np.ndarray, reach: int) -> np.ndarray:
    """Return the mean of each pixel's square."""
    for axis in (0, 1):
        around = np.pad(values, [(reach + 1, reach) if k == axis else (0, 0) for k in (0, 1)], mode="edge")
        sums = np.cumsum(around, axis=axis, dtype=np.float64)
        wide, count = 2 * reach + 1, values.shape[axis]
        values = (
            np.take(sums, np.arange(wide, wide + count), axis) - np.take(sums, np.arange(count), axis)
        ) / wide
    return values
