"""Pieces that masks lost, where depth shows the rope to go on from one part of the mask to another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.above_table import measure_heights, select_standing
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage

_MARGIN = 4  # pixels around the mask that heights are measured in
_AROUND = 2.0  # radii farther
_MIN_RIM = 1.5  # pixels beside a mask that stand out because its edge is not exact
_RIM = 0.4  # radii: the same
_MIN_AREA = 1.5  # squared radii of a piece without its rims
_MAX_AREA = 40.0  # squared radii: larger pieces are other things
_MIN_HALF_WIDTH = 0.7  # radii: narrower pieces are parts of a rope's edge
_MAX_HALF_WIDTH = 1.7  # radii: wider pieces are other things
_TOUCH = 1.6  # pixels farther than its rim from a piece: mask that it touches
_MIN_TOUCH = 0.8  # radii along a touch
_MAX_TOUCH = 5.0  # radii along a touch: a longer one is the side of a strand
_MAX_STEP = 1.0  # radii between the heights of a piece and of the mask that it touches
_END_REACH = 2.5  # radii around a touch in which the mask is examined
_MAX_END_SHARE = 0.36  # of that disc is mask where a mask ends; beside a strand more is


def add_lost_pieces(
    images: Sequence[DepthImage], table: Plane | None, bounds: Box | None, radius: float
) -> list[DepthImage]:
    """Add what stands out of the table as a rope of a radius, metres, and joins an end of a mask to the mask.

    A mask stays as it is where no piece does, and without a table.
    """
    if table is None:
        return list(images)
    return [_mend_mask(image, table, bounds, radius) for image in images]


def _mend_mask(image: DepthImage, table: Plane, bounds: Box | None, radius: float) -> DepthImage:
    pixels = radius * image.camera.focal[0] / image.distance
    if image.labels is None or not np.isfinite(pixels):
        return image
    window = image.frame_mask(_MARGIN + int(_AROUND * pixels))
    part = image.cropped(window)
    mask = part.mask
    heights = measure_heights(part, table, bounds, radius)
    above, seen, _ = heights
    stands = select_standing(heights, radius)
    if part.occluders is not None:
        stands = stands & ~part.occluders
    rim = max(_MIN_RIM, _RIM * pixels)
    margin = int(rim + _TOUCH) + 2
    added = np.zeros_like(mask)
    for corner, piece in _core.find_pieces_beside(
        stands, mask, rim, pixels**2, (_MIN_AREA, _MAX_AREA), margin
    ):
        box = tuple(slice(first, first + size) for first, size in zip(corner, piece.shape, strict=True))
        width = float(_core.measure_edge_distances(piece, int(2.0 * _MAX_HALF_WIDTH * pixels) + 2).max())
        if not _MIN_HALF_WIDTH * pixels < width < _MAX_HALF_WIDTH * pixels:
            continue
        away = _measure_distances(piece, rim + _TOUCH)
        touched = mask[box] & (away <= rim + _TOUCH)
        in_radii = np.where(seen[box], above[box] / radius, np.nan)
        if _joins_an_end(mask, touched, np.array(corner), pixels) and _is_level(in_radii, piece, touched):
            added[box] |= stands[box] & (away <= rim)
    if not (added & ~mask).any():
        return image
    mended = image.mask.copy()
    mended[window] |= added
    return replace(image, labels=mended)


def _measure_distances(mask: NDArray[np.bool_], most: float) -> NDArray[np.float32]:
    """(H, W) Return distances of pixels from a mask, pixels; 0 in it, exact up to `most`."""
    return _core.measure_edge_distances(~mask, int(most) + 2)


def _joins_an_end(
    mask: NDArray[np.bool_], touched: NDArray[np.bool_], corner: NDArray[np.int64], pixels: float
) -> bool:
    """Tell whether a piece touches a mask at several places, of which one is an end of the mask.

    The touched pixels are those of a part of the mask, whose first row and column are given.
    """
    numbers = _core.number_blobs(touched)
    places: list[Array] = []
    for number in range(1, int(numbers.max()) + 1):
        place = corner + np.argwhere(numbers == number)
        along = float(np.ptp(place, axis=0).max()) + 1.0
        if along > _MAX_TOUCH * pixels:
            return False
        if along >= _MIN_TOUCH * pixels:
            places.append(place.mean(axis=0))
    return len(places) > 1 and any(_is_end(mask, place, pixels) for place in places)


def _is_level(heights: Array, piece: NDArray[np.bool_], touched: NDArray[np.bool_]) -> bool:
    """Tell whether a piece is as high, radii, as the mask that it touches."""
    own, others = (heights[some & np.isfinite(heights)] for some in (piece, touched))
    return (
        min(len(own), len(others)) > 0 and abs(_core.find_median(own) - _core.find_median(others)) < _MAX_STEP
    )


def _is_end(mask: NDArray[np.bool_], place: Array, pixels: float) -> bool:
    """Tell whether a mask ends at a place, row and column, rather than passing it."""
    reach = _END_REACH * pixels
    low = np.maximum(np.floor(place - reach), 0).astype(np.int64)
    high = np.ceil(place + reach).astype(np.int64) + 1
    around = mask[low[0] : high[0], low[1] : high[1]]
    rows, columns = (low[k] + np.arange(around.shape[k]) - place[k] for k in (0, 1))
    disc = rows[:, None] ** 2 + columns**2 <= reach**2
    return bool(np.count_nonzero(around & disc) < _MAX_END_SHARE * np.pi * reach**2)
