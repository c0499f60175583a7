"""Masks that are wider than their ropes, slimmed to what stands out of the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.above_table import Heights, measure_heights, select_standing
from strand.reconstruction.images.outlines import (
    MAX_FINE,
    ROUNDNESS,
    STEPS_BY_MASK,
    WEIGHT_BY_MASK,
    estimate_height_noise,
    outline_ropes,
)
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage

MIN_WIDER = 1.25  # pixels on each side: masks that are wider than ropes by less are as wide
_MIN_WIDER_SHARE = 1.25  # times as wide as ropes: the same
MAX_SHARE = 5.0  # of the radius: masks that are wider show something else
_MARGIN = 2  # pixels around the mask that heights are measured in
_AROUND = 2.0  # radii farther
_MIN_COVERED = 0.98  # of a mask lies as near to what stands out of the table as the mask is too wide
_MIN_FINE_COVERED = 0.9  # of a mask lies as near to what stands out of the table, where depth is fine
_SPECK = 3.0  # squared radii: smaller pieces are specks
_REACH = 1.5  # pixels farther: edges of both are ragged
_MIN_SHARE = 0.6  # of the ropes' radius: narrower strips that stand out are parts of ropes


def measure_excess(taken: Sequence[DepthImage], shown: Sequence[float] | Array, radius: float) -> float:
    """Return how much wider on each side masks are than ropes of a radius, metres, in pixels of the images.

    `shown` are the radii that the masks show, pixels.
    """
    wider = [
        float(pixels) - radius * image.camera.focal[0] / image.distance
        for image, pixels in zip(taken, shown, strict=True)
    ]
    return _core.find_median(wider)


def slim_fat_masks(
    images: Sequence[DepthImage], table: Plane | None, bounds: Box | None, radius: float
) -> list[DepthImage]:
    """Cut masks that are wider than ropes of a radius, metres, to what stands out of their table.

    A mask stays as it is if depth does not show all of its ropes, or it is as wide as they are.
    """
    if table is None:
        return list(images)
    return [_slim_mask(image, table, bounds, radius) for image in images]


def _slim_mask(image: DepthImage, table: Plane, bounds: Box | None, radius: float) -> DepthImage:
    pixels = radius * image.camera.focal[0] / image.distance
    shown = image.mask_radius
    if shown is None:
        return image
    window = image.frame_mask(_MARGIN + int(_AROUND * pixels))
    part = image.cropped(window)
    heights = measure_heights(part, table, bounds, radius)
    if estimate_height_noise(part, heights, radius) < MAX_FINE * radius:
        return _cut_fine_mask(image, part, window, heights, table, radius, shown)
    own = part.mask & select_standing(heights, radius)
    slimmed = _mark(image, window, own)
    slim = slimmed.mask_radius
    if slim is None or slim < _MIN_SHARE * pixels:
        return image
    speck = _SPECK * pixels**2
    whole = _count_pieces(own, speck) <= _count_pieces(part.mask, speck)
    if not whole or measure_cover(part.mask, own, max(shown - slim, 0.0) + _REACH) < _MIN_COVERED:
        return image
    if shown < max(slim + MIN_WIDER, _MIN_WIDER_SHARE * slim) or shown > MAX_SHARE * pixels:
        return image
    return slimmed


def _mark(image: DepthImage, window: tuple[slice, slice], own: NDArray[np.bool_]) -> DepthImage:
    """Return an image with the mask of a part of it."""
    found = np.zeros_like(image.mask)
    found[window] = own
    return replace(image, labels=found)


def _cut_fine_mask(
    image: DepthImage,
    part: DepthImage,
    window: tuple[slice, slice],
    heights: Heights,
    table: Plane,
    radius: float,
    shown: float,
) -> DepthImage:
    """Cut a mask to what stands out of its table in depth that shows the gaps between strands.

    `part` is the window of the image around the mask; `heights` are those of its pixels.
    """
    mask = part.mask
    pixels = radius * image.camera.focal[0] / image.distance
    (outlined,) = outline_ropes(
        part, heights, table, radius, ROUNDNESS * radius, [WEIGHT_BY_MASK], steps=STEPS_BY_MASK
    )
    own = mask & outlined.mask
    if shown > MAX_SHARE * pixels or np.array_equal(own, mask):
        return image  # nothing stands out, or nothing but the ropes is in the mask
    slimmed = _mark(image, window, own)
    slim = slimmed.mask_radius
    if slim is None or slim < _MIN_SHARE * pixels:
        return image  # parts of ropes stand out
    excess = max(shown - slim, 0.0)
    reach = excess + _REACH
    bare = mask & (_core.measure_edge_distances(~own, int(reach) + 2) > reach)
    if np.count_nonzero(bare) > (1.0 - _MIN_FINE_COVERED) * np.count_nonzero(mask):
        return image
    if bare.any():
        # depth does not show this part of the ropes
        near = _core.measure_edge_distances(~bare, int(reach) + 2) <= reach
        own |= near & (_core.measure_edge_distances(mask, int(excess) + 2) > excess)
        return _mark(image, window, own)
    return slimmed


def _count_pieces(mask: NDArray[np.bool_], least: float) -> int:
    """Return the number of connected pieces of a mask that have at least so many pixels."""
    sizes = np.bincount(_core.number_blobs(mask).ravel())[1:]
    return int(np.count_nonzero(sizes >= least))


def measure_cover(mask: NDArray[np.bool_], own: NDArray[np.bool_], reach: float) -> float:
    """Return the share of a mask that is within a reach, pixels, of a part of it."""
    away = _core.measure_edge_distances(~own, int(reach) + 2)
    return float(np.mean(away[mask] <= reach))
