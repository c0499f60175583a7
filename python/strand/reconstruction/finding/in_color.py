"""Ropes in a view's colours."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.color_masks.color_pieces import Piece
from strand.reconstruction.color_masks.near_table import NearTable, find_near_table
from strand.reconstruction.color_masks.rope_mask import search_mask
from strand.reconstruction.images.table_plane import Plane
from strand.views.depth_image import DepthImage

_BLACK = -16.0  # Lab: light of black on lines of one hue
_SAME_HUE = 5.0  # Lab: shades of one colour differ by less beside their light
_BESIDE = 4  # pixels around a mask: heights are blurred that far
_MISSED_SCATTERS = 4.0  # scatters of the table's heights: what is higher stands on it
_MISSED_AREA = 20.0  # squared half widths of such pixels that may be another rope
_MAX_RATIO = 2.5  # the mask's half width over that of its strips; and its inverse


@dataclass(frozen=True, eq=False)
class ShownInColor:
    """Ropes that colour shows.

    Attributes
    ----------
    mask : (H, W) ndarray of bool
        Empty if colour shows none.
    radius : float
        The ropes', metres; NaN if there is none.
    plane : Plane
        The table, world frame.
    scatter : float
        Standard deviation of the table's heights, metres.
    shaded : bool
        Whether ropes differ from the table in light alone, as shadows do.
    missed : bool
        Whether something else as high as the ropes may stand on the table.
    why : str
        Why colour shows none.
    """

    mask: NDArray[np.bool_]
    radius: float
    plane: Plane
    scatter: float
    shaded: bool = False
    missed: bool = False
    why: str = ""


def find_in_color(image: DepthImage | None) -> ShownInColor | None:
    """Find ropes in an image's colours; None without colours or a table."""
    if image is None or image.colors is None:
        return None
    table = find_near_table(image.depth, image.camera)
    if table is None or not math.isfinite(table.scatter):
        return None
    found, pieces = search_mask(image.colors, table, None, None)
    rotation, camera = image.pose[:3, :3], image.pose[:3, 3]
    normal = rotation @ table.plane.normal
    plane = Plane(normal, table.plane.offset + float(normal @ camera))
    if not found or found.radius is None:
        empty = np.zeros_like(found.mask)
        return ShownInColor(empty, float("nan"), plane, table.scatter, why=found.why)
    mask = found.mask.copy()
    radius = _measure_radius(mask, found.radius, found.radius_px)
    missed = _may_miss(table, mask, found.radius, found.radius_px)
    return ShownInColor(mask, radius, plane, table.scatter, _are_shaded(pieces), missed)


def _measure_radius(mask: NDArray[np.bool_], radius: float, radius_px: float) -> float:
    """Return the ropes' radius, metres, from their width in a mask, given that of the strips."""
    own = _core.estimate_mask_radius(mask)
    if own is None or not 1.0 / _MAX_RATIO < own / radius_px < _MAX_RATIO:
        return radius
    return radius * own / radius_px


def _are_shaded(pieces: list[Piece]) -> bool:
    """Tell whether most pieces differ from the background in light alone."""
    black = np.array([_BLACK, 0.0, 0.0])
    shaded = total = 0.0
    for piece in pieces:
        own, table = piece.color - black, piece.background - black
        part = float(own @ table) / max(float(table @ table), 1e-9)
        total += piece.length
        shaded += piece.length * bool(np.linalg.norm(own - part * table) < _SAME_HUE)
    return shaded > 0.5 * total


def _may_miss(table: NearTable, mask: NDArray[np.bool_], radius: float, radius_px: float) -> bool:
    """Tell whether enough pixels outside a mask stand as high on a table as a rope of its radius, metres."""
    with np.errstate(invalid="ignore"):
        high = table.heights > max(radius, _MISSED_SCATTERS * table.scatter)
    if np.count_nonzero(high) < _MISSED_AREA * radius_px**2:
        return False
    near = _core.measure_edge_distances(np.asarray(~mask), _BESIDE + 1) <= _BESIDE
    return bool(np.count_nonzero(high & ~near) > _MISSED_AREA * radius_px**2)
