"""Ropes told from their table in depths that scatter widely: the likeliest mask with a short outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.images.above_table import MIN_HEIGHT, measure_heights
from strand.reconstruction.images.table_plane import Plane
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage

# pixels are averaged until a rope's radius is about this many of them: what is finer is lost in the noise
_FINE = 3.0
# ropes are this much above their table where they begin, radii, and heights count only up to there
_EDGE, _HIGHEST = 0.6, 4.0
# noise that is left at least, radii, as ropes are not quite round nor their poses exact
_LEAST = 0.2
# steps of the search for an outline
_STEPS = 80
# around what stands out in the smoothed image: radii, and pixels more
_MARGIN = 3.0, 4


def averaged(image: DepthImage, radius: float) -> tuple[DepthImage, int]:
    """Average squares of pixels until ropes are not finer than noise lets them be seen.

    Parameters
    ----------
    image : DepthImage
    radius : float
        Metres.

    Returns
    -------
    DepthImage, int
        And how many pixels a side of a square is.
    """
    seen = image.depth > 0
    if not seen.any():
        return image, 1
    side = round(radius * image.camera.focal[0] / float(np.median(image.depth[seen])) / _FINE)
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
    return DepthImage(depth, image.camera.averaged(side), image.pose, mask), side


def mean_noise(scatter: float, side: int, radius: float) -> float:
    """Return the standard deviation of means of so many pixels a side, and of ropes about tubes, metres."""
    return max(scatter / side, _LEAST * radius)


def outlined(
    image: DepthImage,
    table: Plane,
    bounds: Box | None,
    radius: float,
    noise: float,
    weights: Sequence[float],
) -> list[DepthImage]:
    """Return an image with the likeliest masks, whose outlines cost.

    What a pixel says for a rope is its height over half of a rope's there, in units of the noise.

    Parameters
    ----------
    image : DepthImage
        With a first mask, around which ropes are looked for.
    table : Plane
    bounds : Box or None
        The extraction range, metres.
    radius : float
        Metres.
    noise : float
        Standard deviation of depth, metres.
    weights : sequence of float
        What a pixel's length of outline costs, for each mask.

    Returns
    -------
    list of DepthImage
        For each weight; the same image where nothing is left of its mask.
    """
    rows, columns = (np.flatnonzero(image.mask.any(axis=axis)) for axis in (1, 0))
    if not len(rows):
        return [image] * len(weights)
    above, seen, across = measure_heights(image, table, bounds, radius)
    reach = int(_MARGIN[0] * across) + _MARGIN[1]
    part = (
        slice(max(rows[0] - reach, 0), rows[-1] + reach + 1),
        slice(max(columns[0] - reach, 0), columns[-1] + reach + 1),
    )
    # depth along the ray is seen as height at a slant
    variance = (noise / radius * float(table.normal @ image.pose[:3, 2])) ** 2
    clipped = np.clip(above[part] / radius, MIN_HEIGHT, _HIGHEST)
    evidence = np.where(seen[part], (_EDGE - clipped) * _EDGE / max(variance, 1e-6), 0.0)
    found = []
    for outline in _core.short_outlines(evidence.astype(np.float32), weights, _STEPS):
        mask = np.zeros_like(image.mask)
        mask[part] = outline
        found.append(image.masked(mask) if outline.any() else image)
    return found
