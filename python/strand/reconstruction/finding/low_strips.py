"""Strips on a table that are too low for ropes of the given radius: they may be thinner ropes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.finding.standing import Tabletop
from strand.reconstruction.finding.widths import measure_strip_lengths
from strand.support.checks import Array
from strand.views.depth_image import list_pixels

_BESIDE = 4  # pixels around what stands high: its edges are low there
_MIN_LENGTH = 8.0  # radii of the ropes: shorter strips are no ropes
_MIN_SLENDERNESS = 8.0  # length over half width: strips that are less slender are no ropes
_MAX_WIDTH = 1.2  # radii of the ropes: wider strips are low things


def find_low_strips(top: Tabletop, standing: NDArray[np.bool_], radius: float) -> list[Array]:
    """Return the middles (3,) of slender strips that stand on a table and are no rope, longest first.

    Parameters
    ----------
    top : Tabletop
        Its mask is all that stands above the table.
    standing : (H, W) ndarray of bool
        What stands as high as ropes.
    radius : float
        The ropes', metres.
    """
    low = top.image.mask & top.inside & ~standing
    if not low.any():
        return []
    if standing.any():
        low &= _core.measure_edge_distances(~standing, _BESIDE + 1) > _BESIDE
    image = replace(top.image, labels=low)
    lengths = measure_strip_lengths(image)
    numbers = _core.number_blobs(low)
    found = []
    for blob in np.argsort(-lengths):
        length = float(lengths[blob])
        if length < _MIN_LENGTH * radius:
            break
        rows, columns = list_pixels((numbers == blob) & low & (image.depth > 0))
        z = image.depth[rows, columns]
        half_width = 0.5 * float(np.sum(z**2)) / (image.camera.focal[0] * image.camera.focal[1]) / length
        if half_width < _MAX_WIDTH * radius and length > _MIN_SLENDERNESS * half_width:
            middle = len(rows) // 2
            found.append(image.lift(rows[middle], columns[middle], z[middle]))
    return found
