"""Thin ropes on a finer grid: masks of a few pixels' width are magnified before they are read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_THIN_RADIUS = 2.5  # pixels: ropes of a smaller radius are read on a finer grid
_FINE_RADIUS = 4.5  # pixels of the finer grid: a rope's radius there
_MAX_FACTOR = 6  # pixels of the finer grid along a pixel's side
_BAND = 20.0  # radii around the mask that are kept
_MIN_BAND = 8  # pixels around the mask that are kept
_CUBIC = -0.75  # slope of the cubic kernel at one pixel


def magnify_thin_ropes(images: Sequence[DepthImage], radius: float) -> tuple[list[DepthImage], int]:
    """Return images whose ropes of a radius, metres, are wide enough to read, and their magnification.

    All images are magnified by the same whole number, and cropped around their masks. Where ropes are wide
    enough, or masks show nothing, the images stay as they are, and the number is 1.
    """
    given = _core.find_median([radius * image.camera.focal[0] / image.distance for image in images])
    if not given < _THIN_RADIUS:
        return list(images), 1
    shown = [image.mask_radius or 0.0 for image in images]
    # a mask may be wider than the rope in it
    pixels = max(given, _core.find_median(shown))
    if pixels >= _THIN_RADIUS:
        return list(images), 1
    factor = int(min(np.ceil(_FINE_RADIUS / pixels), _MAX_FACTOR))
    band = int(np.ceil(_BAND * pixels)) + _MIN_BAND
    return [_magnify_image(image, factor, band) for image in images], factor


def _magnify_image(image: DepthImage, factor: int, band: int) -> DepthImage:
    """Return the part of an image within `band` pixels of its mask, magnified."""
    if not image.mask.any():
        return image
    window = image.frame_mask(band)
    depth = image.depth[window].repeat(factor, axis=0).repeat(factor, axis=1)
    corner = (float(window[1].start), float(window[0].start))
    camera = image.camera.magnified(factor, corner)
    occluders = None
    if image.occluders is not None:
        occluders = image.occluders[window].repeat(factor, axis=0).repeat(factor, axis=1)
    mask = _magnify_mask(image.mask[window], factor)
    return DepthImage(depth, camera, image.pose, mask, None, occluders)


def _magnify_mask(mask: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return a mask magnified by a whole number: cubic interpolation, cut at a half."""
    values = _interpolate_rows(mask.astype(np.float32), factor)
    return np.ascontiguousarray(_interpolate_rows(values.T, factor).T > 0.5)


def _interpolate_rows(values: NDArray[np.float32], factor: int) -> NDArray[np.float32]:
    """Return an image with `factor` times as many rows, by cubic convolution (Keys, 1981)."""
    height = len(values)
    padded = np.pad(values, ((2, 2), (0, 0)), mode="edge")
    made = np.empty((height * factor, values.shape[1]), dtype=np.float32)
    for phase in range(factor):
        shift = (phase + 0.5) / factor - 0.5
        first = int(np.floor(shift)) - 1
        weights = _weigh_cubic(np.abs(shift - first - np.arange(4)))
        made[phase::factor] = sum(
            weight * padded[2 + first + k : 2 + first + k + height]
            for k, weight in enumerate(weights.astype(np.float32))
        )
    return made


def _weigh_cubic(away: Array) -> Array:
    """Return the cubic kernel at distances of pixels below two."""
    near = ((_CUBIC + 2.0) * away - (_CUBIC + 3.0)) * away**2 + 1.0
    far = ((_CUBIC * away - 5.0 * _CUBIC) * away + 8.0 * _CUBIC) * away - 4.0 * _CUBIC
    return np.where(away <= 1.0, near, far)
