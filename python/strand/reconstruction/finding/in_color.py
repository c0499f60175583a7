"""Ropes in a view's colours."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.color_masks.near_table import find_near_table
from strand.reconstruction.color_masks.rope_mask import find_mask
from strand.reconstruction.images.table_plane import Plane
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_RESOLVED = 0.5  # radii: where the table's depths scatter less, height shows ropes
_NARROW = 2.5  # pixels: masks of thinner ropes grow before they are traced
_GROWTH = 2.0  # pixels that they grow


@dataclass(frozen=True, eq=False)
class ShownInColor:
    """Ropes that colour shows.

    Attributes
    ----------
    mask : (H, W) ndarray of bool
        Wider than the ropes where these are thin; empty if colour shows none.
    radius : float
        The ropes', metres, from the mask before it grew; NaN if there is none.
    plane : Plane
        The table, world frame.
    resolved : bool
        Whether depth could show the ropes' height.
    """

    mask: NDArray[np.bool_]
    radius: float
    plane: Plane
    resolved: bool


def find_in_color(image: DepthImage | None, radii: Array | None) -> ShownInColor | None:
    """Find ropes of (K,) radii, metres, in an image's colours; None without colours or a table."""
    if image is None or image.colors is None:
        return None
    table = find_near_table(image.depth, image.camera)
    if table is None:
        return None
    found = find_mask(image.colors, table, None, None)
    rotation, camera = image.pose[:3, :3], image.pose[:3, 3]
    normal = rotation @ table.plane.normal
    plane = Plane(normal, table.plane.offset + float(normal @ camera))
    if not found or found.radius is None:
        return ShownInColor(np.zeros_like(found.mask), float("nan"), plane, False)
    thinnest = found.radius if radii is None else float(radii.min())
    mask = found.mask.copy()
    if found.radius_px < _NARROW:
        mask = np.asarray(_core.measure_edge_distances(~mask, math.ceil(_GROWTH) + 1) <= _GROWTH)
    return ShownInColor(mask, found.radius, plane, table.scatter <= _RESOLVED * thinnest)
