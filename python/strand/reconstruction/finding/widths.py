"""Widths of the strips that stand above a table: most of them are ropes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_MIN_RADIUS = 0.0008  # metres
_MAX_RADIUS = 0.03  # metres
_RADII = 120  # radii that are tried
_SAME_WIDTH = 0.2  # logarithm of half widths: strips of one width differ by less
_MIN_BLOB = 10.0  # half widths: shorter blobs are specks and things


def estimate_strip_radius(images: Sequence[DepthImage]) -> float:
    """Return the half width, metres, of the strips in masks that are longest for their width."""
    radii = np.exp(np.linspace(np.log(_MIN_RADIUS), np.log(_MAX_RADIUS), _RADII))
    logs, lengths = (
        np.concatenate(parts) for parts in zip(*(_find_long(image) for image in images), strict=True)
    )
    order = np.argsort(logs)
    logs, sums = logs[order], np.concatenate([[0.0], np.cumsum(lengths[order])])
    first, last = (np.searchsorted(logs, np.log(radii) + side) for side in (-_SAME_WIDTH, _SAME_WIDTH))
    scores = (sums[last] - sums[first]) / radii
    return float(radii[int(np.argmax(scores))])


def _find_long(image: DepthImage) -> tuple[Array, Array]:
    """Return half widths and lengths as `_find_middles` does: those of blobs that are no specks, if any."""
    logs, lengths, blobs = _find_middles(image)
    total, mean = np.bincount(blobs, lengths), np.bincount(blobs, lengths * logs)
    long = total > _MIN_BLOB * np.exp(mean / np.maximum(total, 1e-12))
    kept = long[blobs]
    return (logs[kept], lengths[kept]) if kept.any() else (logs, lengths)


def measure_strip_lengths(image: DepthImage, radius: float | None = None) -> Array:
    """(B + 1,) Return the lengths of the strips in each blob of a mask along their middle, metres.

    With a radius, metres, only strips of about this half width count.
    """
    logs, lengths, blobs = _find_middles(image)
    if radius is not None:
        lengths = np.where(np.abs(logs - np.log(radius)) < _SAME_WIDTH, lengths, 0.0)
    return np.asarray(np.bincount(blobs, lengths), dtype=np.float64)


def _find_middles(image: DepthImage) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return logarithms of half widths, lengths, metres, and blobs' numbers of pixels in strips' middles."""
    middles, away, blobs = image.strip_middles
    depth = image.depth.reshape(-1)[middles]
    seen = depth > 0
    pixel = depth[seen] / image.camera.focal[0]
    # the edge runs between the pixels
    return np.log((away[seen] - 0.5) * pixel), pixel, blobs[seen]
