"""Ropes in a view's colours."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.color_masks.color_pieces import Piece
from strand.reconstruction.color_masks.near_table import NearTable, find_near_table
from strand.reconstruction.color_masks.rope_mask import search_mask
from strand.reconstruction.color_masks.shades import measure_from_line
from strand.reconstruction.finding.earlier import Window, find_window, touches_side
from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

RESOLVED = 0.5  # radii: where the table's depths scatter less, height shows ropes
_SAME_HUE = 5.0  # Lab: shades of one colour differ by less beside their light
_BESIDE = 4  # pixels around a mask: heights are blurred that far
_MISSED_SCATTERS = 4.0  # scatters of the table's heights: what is higher stands on it
_MISSED_AREA = 20.0  # squared half widths of such pixels that may be another rope
_MAX_RATIO = 2.5  # the mask's half width over that of its strips; and its inverse
_SAME_COLOR = 30.0  # Lab: colours of one rope in two views differ less


@dataclass(frozen=True, eq=False)
class ShownInColor:
    """Ropes that colour shows.

    Attributes
    ----------
    labels : (H, W) ndarray of int32
        The ropes' colours, as in `RopeMask`; all 0 if colour shows none.
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

    labels: NDArray[np.int32]
    radius: float
    plane: Plane
    scatter: float
    shaded: bool = False
    missed: bool = False
    why: str = ""

    @property
    def mask(self) -> NDArray[np.bool_]:
        """(H, W) The pixels that have a label."""
        return self.labels > 0


def find_in_color(image: DepthImage | None, earlier: Sequence[Chain] = ()) -> ShownInColor | None:
    """Find ropes in an image's colours; None without colours or a table.

    They are sought near chains of an earlier frame first.
    """
    if image is None or image.colors is None:
        return None
    table = find_near_table(image.depth, image.camera)
    if table is None or not math.isfinite(table.scatter):
        return None
    if image.occluders is not None:
        table = replace(table, near=table.near & ~image.occluders)
    window = find_window(image, earlier)
    if window is not None:
        shown = _search(image, image.colors, table, window)
        # where depth resolves ropes, whatever stands elsewhere demands a search of the whole image
        missed = shown.missed and shown.scatter <= RESOLVED * shown.radius
        if shown.mask.any() and not missed and not touches_side(shown.mask, window):
            return shown
    return _search(image, image.colors, table, (slice(None), slice(None)))


def _search(image: DepthImage, colors: NDArray[np.uint8], table: NearTable, window: Window) -> ShownInColor:
    """Find ropes in a window of an image with colours and a table."""
    own, diagonal = np.ascontiguousarray(colors[window]), math.hypot(*image.depth.shape)
    found, pieces = search_mask(own, table.cut(window), None, None, diagonal)
    rotation, camera = image.pose[:3, :3], image.pose[:3, 3]
    normal = rotation @ table.plane.normal
    plane = Plane(normal, table.plane.offset + float(normal @ camera))
    labels = np.zeros(image.depth.shape, dtype=np.int32)
    if not found or found.radius is None:
        return ShownInColor(labels, float("nan"), plane, table.scatter, why=found.why)
    labels[window] = found.labels
    if image.occluders is not None:
        labels[image.occluders] = 0
    mask = labels > 0
    radius = _measure_radius(mask, found.radius, found.radius_px)
    missed = _may_miss(table, mask, found.radius, found.radius_px)
    return ShownInColor(labels, radius, plane, table.scatter, _are_shaded(pieces), missed)


def _measure_radius(mask: NDArray[np.bool_], radius: float, radius_px: float) -> float:
    """Return the ropes' radius, metres, from their width in a mask, given that of the strips."""
    own = _core.RopeMask(mask).estimate_radius()
    if own is None or not 1.0 / _MAX_RATIO < own / radius_px < _MAX_RATIO:
        return radius
    return radius * own / radius_px


def _are_shaded(pieces: list[Piece]) -> bool:
    """Tell whether most pieces differ from the background in light alone."""
    shaded = total = 0.0
    for piece in pieces:
        (away,) = measure_from_line(piece.color[None], piece.background[None], (-math.inf, math.inf))
        total += piece.length
        shaded += piece.length * bool(away < _SAME_HUE)
    return shaded > 0.5 * total


def _may_miss(table: NearTable, mask: NDArray[np.bool_], radius: float, radius_px: float) -> bool:
    """Tell whether enough pixels outside a mask stand as high on a table as a rope of its radius, metres."""
    # depths of most cameras scatter by the square of the distance
    farther = np.maximum(table.depth / -table.plane.offset, 1.0) ** 2
    with np.errstate(invalid="ignore"):
        high = table.heights > np.maximum(radius, _MISSED_SCATTERS * table.scatter * farther)
    if np.count_nonzero(high) < _MISSED_AREA * radius_px**2:
        return False
    near = _core.measure_edge_distances(np.asarray(~mask), _BESIDE + 1) <= _BESIDE
    return bool(np.count_nonzero(high & ~near) > _MISSED_AREA * radius_px**2)


def match_labels(shown: Sequence[ShownInColor], images: Sequence[DepthImage]) -> list[NDArray[np.int32]]:
    """Return each view's labels with one number for one colour in all views."""
    known: list[Array] = []
    matched = []
    for one, image in zip(shown, images, strict=True):
        assert image.colors is not None
        labels = np.zeros_like(one.labels)
        left = set(range(len(known)))
        for label in np.unique(one.labels[one.labels > 0]):
            own = one.labels == label
            color = _core.convert_to_lab(np.ascontiguousarray(image.colors[own][None]))
            middle = np.median(color[:, 0].astype(np.float64), axis=1)
            away = {k: float(np.linalg.norm(known[k] - middle)) for k in left}
            number = min(away, key=away.__getitem__, default=-1)
            if number < 0 or away[number] > _SAME_COLOR:
                number = len(known)
                known.append(middle)
            left.discard(number)
            labels[own] = number + 1
        matched.append(labels)
    return matched
