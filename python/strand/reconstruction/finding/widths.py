"""How wide the strips are that stand above a table: the radius that ropes among them have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.images.rope_image import RopeImage
from strand.support.checks import Array

# half widths that may be a rope's, metres, and how much they vary along one, as a logarithm
_NARROWEST, _WIDEST, _STEPS, _ALIKE = 0.0008, 0.03, 120, 0.2
# the middle of a strip is so far from its edge at least, pixels
_LEAST = 1.5


def strip_radius(images: Sequence[RopeImage]) -> float:
    """Find the half width that most of the strips in masks have, for their width.

    Parameters
    ----------
    images : sequence of RopeImage
        With masks of what stands above the table.

    Returns
    -------
    float
        Metres.
    """
    grid = np.exp(np.linspace(np.log(_NARROWEST), np.log(_WIDEST), _STEPS))
    logs, lengths = (
        np.concatenate(parts) for parts in zip(*(_middles(image)[:2] for image in images), strict=True)
    )
    scores = [lengths[np.abs(logs - np.log(radius)) < _ALIKE].sum() / radius for radius in grid]
    return float(grid[int(np.argmax(scores))])


def strip_lengths(image: RopeImage, radius: float | None = None) -> Array:
    """(B + 1,) How long the strips in each blob of a mask are along their middle, metres.

    Parameters
    ----------
    image : RopeImage
    radius : float, optional
        Only those of about this half width count, metres.
    """
    logs, lengths, middle = _middles(image)
    own = _core.blob_numbers(image.mask)[middle]
    if radius is not None:
        lengths = np.where(np.abs(logs - np.log(radius)) < _ALIKE, lengths, 0.0)
    return np.asarray(np.bincount(own, lengths), dtype=np.float64)


def _middles(image: RopeImage) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Logarithms of half widths and lengths, metres, at the pixels of strips' middles, and these pixels."""
    away = _core.edge_distances(image.mask, sum(image.mask.shape))
    around = np.pad(away, 1)
    height, width = away.shape
    most = away.copy()
    for down in range(3):
        for right in range(3):
            np.maximum(most, around[down : down + height, right : right + width], out=most)
    middle = (away >= most) & (away > _LEAST) & (image.depth > 0)
    pixel = image.depth[middle] / image.focal[0]
    # the edge runs between the pixels
    return np.log((away[middle] - 0.5) * pixel), pixel, middle
