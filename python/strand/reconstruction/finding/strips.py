"""Ropes segmented from other things on a table: strips of one width that are thin or low."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.finding.standing import Tabletop
from strand.reconstruction.finding.widths import measure_strip_lengths
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_WIDE = 1.6  # radii: what has a larger half width is wider than crossing strands
_MAX_PILE = 5.5  # radii: ropes pile up no higher
_BESIDE = 3.0  # radii around a thing, seen from above: what is wide there belongs to it
_MIN_LENGTH = 3.0  # radii: shorter pieces are specks
_MIN_LENGTH_BESIDE = 8.0  # radii: shorter pieces beside a thing belong to it
_MIN_LENGTH_HIGH = 30.0  # radii: shorter and high pieces beside a thing belong to it
_HIGH = 3.5  # radii: height of such pieces
_MAX_CELLS = 2000  # cells along each side of a plan
_EDGE = 2.0  # pixels that things are grown by
_HALO = 1.0  # radii beyond these: smoothed heights of things are as high as ropes there
_MAX_HALO_SHARE = 0.7  # share of a piece's pixels there, if it is a rope
_TOP = 0.9  # share of a thing's heights that are below its top


@dataclass(frozen=True, eq=False)
class OtherObject:
    """A thing that stands on the table and is no rope.

    Attributes
    ----------
    view : int
        The view that shows it.
    place : (3,) ndarray
        The middle of its points, world frame, metres.
    reason : str
        Why it is no rope.
    """

    view: int
    place: Array
    reason: str


def segment_ropes(
    top: Tabletop, image: DepthImage, radius: float, view: int
) -> tuple[NDArray[np.bool_], list[OtherObject]]:
    """Segment ropes from other things that stand on a table.

    What is wider than two strands and higher than ropes pile up is a thing. What is wide beside or below it
    belongs to it.

    Parameters
    ----------
    top : Tabletop
    image : DepthImage
        Its image with a mask of what stands at least as high as the thinnest rope.
    radius : float
        The thickest rope's, metres.
    view : int
        The view's number.

    Returns
    -------
    mask : (H, W) ndarray of bool
        Pixels that may be ropes.
    others : list of OtherObject
    """
    things, others = _find_things(top, image, radius, view)
    near: Array | NDArray[np.float32] = np.broadcast_to(np.inf, things.shape)
    halo, mask = 0.0, image.mask.copy()
    if things.any():
        halo = _EDGE + _HALO * _find_radius_px(image, things, radius)
        near = _core.measure_edge_distances(~things, int(max(halo, 2.0 * _EDGE)) + 2)
        mask &= near > _EDGE
    lengths = measure_strip_lengths(replace(image, labels=mask.copy())) / radius
    numbers = _core.number_blobs(mask)
    pixels = np.flatnonzero(mask)
    blobs = numbers.take(pixels)
    long = np.pad(lengths, (0, max(int(blobs.max(initial=0)) + 1 - len(lengths), 0))) >= _MIN_LENGTH
    kept = long[blobs]
    mask.reshape(-1)[pixels] = kept
    for rows, columns in _split_blobs(pixels[kept], blobs[kept], mask.shape[1]):
        length = float(lengths[numbers[rows[0], columns[0]]])
        height = _core.find_median(top.above[rows, columns]) / radius
        beside = bool((near[rows, columns] <= 2.0 * _EDGE).any())
        own = length < _MIN_LENGTH_BESIDE or (length < _MIN_LENGTH_HIGH and height > _HIGH)
        edge = bool(np.mean(near[rows, columns] <= halo) > _MAX_HALO_SHARE)
        if (beside and own) or edge:
            mask[rows, columns] = False
            if beside and not edge:
                reason = f"a thin piece, {1e3 * length * radius:.0f} mm long, of a thing beside it"
                others.append(OtherObject(view, _find_middle(image, rows, columns), reason))
    return mask, others


def _find_things(
    top: Tabletop, image: DepthImage, radius: float, view: int
) -> tuple[NDArray[np.bool_], list[OtherObject]]:
    """Return the pixels of things that are wide and higher than ropes pile up, with what belongs to them."""
    wide = _open_mask(image, radius)
    things = np.zeros_like(wide)
    others: list[OtherObject] = []
    if not wide.any():
        return things, others
    numbers = _core.number_blobs(wide)
    # few pixels of low blobs are high
    pixels = np.flatnonzero(wide)
    own, high = numbers.take(pixels), top.above.take(pixels) > _MAX_PILE * radius
    counts = np.bincount(own)
    tall = np.bincount(own[high], minlength=len(counts)) >= 0.5 * (1.0 - _TOP) * counts
    kept = tall[own]
    for rows, columns in _split_blobs(pixels[kept], own[kept], wide.shape[1]):
        highest = float(np.quantile(top.above[rows, columns], _TOP))
        if highest > _MAX_PILE * radius:
            things[rows, columns] = True
            reason = f"wider than ropes of radius {1e3 * radius:.1f} mm, and {1e3 * highest:.0f} mm high"
            others.append(OtherObject(view, _find_middle(image, rows, columns), reason))
    return things | (wide & _select_around(image, things, top.plane, radius)), others


def _find_radius_px(image: DepthImage, things: NDArray[np.bool_], radius: float) -> float:
    """Return a radius, metres, in pixels at the distance of things; 0 without any."""
    z = image.depth[things & (image.depth > 0)]
    return radius * image.camera.focal[0] / _core.find_median(z) if len(z) else 0.0


def _split_blobs(
    pixels: NDArray[np.intp], own: NDArray[np.int64], width: int
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the rows and columns of the pixels of each blob, in the order of the blobs' numbers.

    The pixels' numbers in the image, which is so wide, and those of their blobs are given.
    """
    order = np.argsort(own, kind="stable")
    for part in np.split(pixels[order], np.flatnonzero(np.diff(own[order])) + 1):
        if len(part):
            yield np.divmod(part, width)


def _find_middle(image: DepthImage, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    """(3,) Return the median of the points that pixels show, world frame."""
    z = image.depth[rows, columns]
    return np.asarray(np.median(image.lift(rows, columns, z)[z > 0], axis=0))


def _open_mask(image: DepthImage, radius: float) -> NDArray[np.bool_]:
    """Return the pixels in discs that fit into the mask and are wider than crossing strands."""
    pixels = image.mask_pixels
    with np.errstate(divide="ignore"):
        reach = _WIDE * radius * image.camera.focal[0] / image.mask_depths
    most = int(reach.max(initial=0.0, where=np.isfinite(reach))) + 2
    away = _core.measure_edge_distances(image.mask, most).reshape(-1)[pixels]
    found = np.zeros(image.mask.size, dtype=bool)
    found[pixels] = away - 0.5 > reach
    if found.any():
        away = _core.measure_edge_distances(~found.reshape(image.mask.shape), most).reshape(-1)[pixels]
        found[pixels] |= away < reach + 0.5
    return found.reshape(image.mask.shape)


def _select_around(
    image: DepthImage, things: NDArray[np.bool_], table: Plane, radius: float
) -> NDArray[np.bool_]:
    """Return the mask's pixels that lie below or beside things, seen from straight above the table."""
    found = np.zeros_like(things)
    if not things.any():
        return found
    rows, columns = image.list_seen()
    plan = image.lift(rows, columns, image.depth[rows, columns]) @ table.axes
    margin = int(_BESIDE) + 1
    low, high = plan.min(axis=0), plan.max(axis=0)
    # a wrong unit may spread a view over kilometres
    side = max(radius, float((high - low).max()) / _MAX_CELLS)
    cells = np.floor((plan - low) / side).astype(np.int64) + margin
    grid = np.zeros(cells.max(axis=0) + margin + 1, dtype=bool)
    grid[tuple(cells[things[rows, columns]].T)] = True
    covered = grid | (_core.measure_edge_distances(~grid, 8) <= _BESIDE)
    found[rows, columns] = covered[tuple(cells.T)]
    return found
