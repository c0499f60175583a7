"""Ropes segmented from their table in depths that scatter widely: the likeliest mask with a short outline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.above_table import MAX_HEIGHT, MIN_HEIGHT, Heights
from strand.support.checks import Array
from strand.support.robust import estimate_deviation
from strand.views.depth_image import DepthImage

_FINEST_RADIUS = 3.0  # pixels: a rope's radius, about, after pixels were averaged
_EDGE_HEIGHT = 0.6  # radii: height of a rope's edge above its table
_MIN_NOISE = 0.2  # radii: ropes are not quite round, nor poses exact
_BESIDE = 2.0  # radii: heights beside a mask that are farther from the table's are other things
MAX_FINE = 0.35  # radii: noise of heights that show gaps between strands at most
_STEPS = 80  # steps of the search for an outline
STEPS_BY_MASK = 40  # the same where a given mask says about where ropes are
WEIGHT_BY_MASK = 0.9  # cost of a pixel's length of outline, where a mask is given
ROUNDNESS = 0.35  # radii: noise of heights about tubes that are not quite round
_MARGIN_RADII = 3.0  # radii around the first mask in which ropes are sought
_MARGIN_PIXELS = 4  # pixels farther


def average_pixels(image: DepthImage, radius: float) -> tuple[DepthImage, int]:
    """Average squares of pixels; return the image and the pixels along a square's side.

    Ropes of a radius, metres, are about three pixels in radius then: noise hides what is finer.
    """
    seen = image.depth > 0
    if not seen.any():
        return image, 1
    side = round(radius * image.camera.focal[0] / _core.find_median(image.depth[seen]) / _FINEST_RADIUS)
    if side < 2:
        return image, 1
    height, width = (count // side for count in image.depth.shape)

    def sums(values: Array | NDArray[np.bool_]) -> Array:
        squares = values[: height * side, : width * side].reshape(height, side, width, side)
        return np.asarray(squares.sum(axis=(1, 3), dtype=np.float64))

    counts = sums(seen)
    depth = sums(image.depth) / np.maximum(counts, 1.0)
    depth[2 * counts < side**2] = 0.0
    mask = 2 * sums(image.mask) > side**2
    occluders = None if image.occluders is None else 2 * sums(image.occluders) > side**2
    return DepthImage(depth, image.camera.averaged(side), image.pose, mask, None, occluders), side


def estimate_mean_noise(scatter: float, side: int, radius: float) -> float:
    """Return the standard deviation of means of `side` by `side` depths about tubes of a radius, metres."""
    return max(scatter / side, _MIN_NOISE * radius)


def estimate_height_noise(image: DepthImage, heights: Heights, radius: float) -> float:
    """Return the standard deviation of heights beside a mask, metres; infinite without any near the table."""
    above, seen, _ = heights
    beside = above[seen & ~image.mask & (np.abs(above) < _BESIDE * radius)]
    return estimate_deviation(beside) if len(beside) else np.inf


def outline_ropes(
    image: DepthImage,
    heights: Heights,
    table: Plane,
    radius: float,
    noise: float,
    weights: Sequence[float],
    prior: float = 0.0,
    steps: int = _STEPS,
) -> list[DepthImage]:
    """Return the image with the likeliest mask for each weight of outlines.

    A pixel's evidence for a rope is how far its height is above half of a rope's, relative to the noise.
    Where no mask is left, the image stays as it is.

    Parameters
    ----------
    image : DepthImage
        With a first mask. Ropes are sought around it.
    heights : tuple
        Its heights above the table, as `measure_heights` returns them.
    table : Plane
    radius : float
        Metres.
    noise : float
        Standard deviation of depth, metres.
    weights : sequence of float
        Cost of a pixel's length of outline, for each mask.
    prior : float
        Evidence of the first mask for a rope in it, and against one beside it.
    steps : int
        Steps of the search for an outline.
    """
    rows, columns = (np.flatnonzero(image.mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return [image] * len(weights)
    above, seen, pixels = heights
    reach = int(_MARGIN_RADII * pixels) + _MARGIN_PIXELS
    part = (
        slice(max(rows[0] - reach, 0), rows[-1] + reach + 1),
        slice(max(columns[0] - reach, 0), columns[-1] + reach + 1),
    )
    # noise is along the ray, which meets heights at a slant
    variance = (noise / radius * float(table.normal @ image.pose[:3, 2])) ** 2
    clipped = np.clip(above[part] / radius, MIN_HEIGHT, MAX_HEIGHT)
    evidence = np.where(seen[part], (_EDGE_HEIGHT - clipped) * _EDGE_HEIGHT / max(variance, 1e-6), 0.0)
    evidence += np.where(image.mask[part], -prior, prior)
    found = []
    for outline in _core.find_short_outlines(evidence.astype(np.float32), weights, steps):
        mask = np.zeros_like(image.mask)
        mask[part] = outline
        found.append(replace(image, labels=mask) if outline.any() else image)
    return found
