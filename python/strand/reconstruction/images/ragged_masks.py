"""Masks with ragged edges, holes and bits of the table: the likeliest outline by the mask and by depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.above_table import measure_heights
from strand.reconstruction.images.fat_masks import measure_cover
from strand.reconstruction.images.outlines import (
    ROUNDNESS,
    STEPS_BY_MASK,
    WEIGHT_BY_MASK,
    estimate_height_noise,
    outline_ropes,
)
from strand.views.box import Box
from strand.views.depth_image import DepthImage

_MIN_RAGGED = 0.075  # of an outline's steps: pixels that differ from most of their neighbours
_MIN_PIXELS = 2.2  # pixels: masks of thinner ropes are not ragged but coarse
_MAX_NOISE = 0.25  # radii: noise of heights at most, as wider windows of matchers blur the rope too
_PRIOR = 1.0  # evidence of a ragged mask for a rope in it, and against one beside it
_CORRELATED = 2.0  # times the noise of heights: errors of neighbouring pixels are correlated
_AROUND_RADII = 2.0  # radii around a mask in which it may have lost parts of ropes
_AROUND_PIXELS = 2.0  # pixels farther
_REACH = 2.5  # pixels: bits of a mask that are farther from its outline are other things
_MIN_COVERED = 0.85  # of a mask lies nearer: with less depth does not show all of its ropes
_MARGIN = 4  # pixels around that


def mend_ragged_masks(
    images: Sequence[DepthImage], table: Plane | None, bounds: Box | None, radius: float
) -> list[DepthImage]:
    """Replace ragged masks of ropes of a radius, metres, by the likeliest outline.

    A mask stays as it is if it is not ragged, its ropes are thin, or depth is too noisy to mend it.
    """
    if table is None:
        return list(images)
    return [_mend_mask(image, table, bounds, radius) for image in images]


def _mend_mask(image: DepthImage, table: Plane, bounds: Box | None, radius: float) -> DepthImage:
    pixels = radius * image.camera.focal[0] / image.distance
    if image.labels is None or not pixels >= _MIN_PIXELS or measure_raggedness(image.mask) < _MIN_RAGGED:
        return image
    around = _AROUND_RADII * pixels + _AROUND_PIXELS
    window = image.frame_mask(_MARGIN + int(around))
    part = image.cropped(window)
    heights = measure_heights(part, table, bounds, radius)
    noise = estimate_height_noise(part, heights, radius)
    if noise > _MAX_NOISE * radius:
        return image
    noise = float(np.hypot(ROUNDNESS * radius, _CORRELATED * noise))
    (outlined,) = outline_ropes(part, heights, table, radius, noise, [WEIGHT_BY_MASK], _PRIOR, STEPS_BY_MASK)
    own = outlined.mask & (_core.measure_edge_distances(~part.mask, int(around) + 2) <= around)
    if part.occluders is not None:
        own &= ~part.occluders
    if outlined is part or measure_cover(part.mask, own, _REACH) < _MIN_COVERED:
        return image
    mended = np.zeros_like(image.mask)
    mended[window] = own
    return replace(image, labels=mended)


def measure_raggedness(mask: NDArray[np.bool_]) -> float:
    """Return the number of pixels that differ from most of their neighbours, per step of a mask's outline."""
    odd, steps = _core.count_odd_pixels(mask)
    return odd / steps if steps else 0.0
