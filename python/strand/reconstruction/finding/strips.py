"""Ropes told from other things that stand on a table: strips of one width that are thin, or low."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.finding.plane import in_plane
from strand.reconstruction.finding.standing import Tabletop
from strand.reconstruction.finding.widths import strip_lengths
from strand.reconstruction.images.above_table import standing_out
from strand.reconstruction.images.rope_image import RopeImage
from strand.support.checks import Array

# in radii: half the width from which on something is wide; as high as ropes pile up; how far around a wide,
# high thing what is wide belongs to it, in plan
_WIDE, _PILE, _BESIDE = 1.6, 5.5, 3.0
# thin pieces beside such a thing belong to it if they are shorter than this and lie this high, or shorter
# than that at any height; shorter pieces anywhere are specks; radii
_SHORT, _HIGH, _SCRAP, _SPECK = 30.0, 3.5, 8.0, 3.0
# cells of a plan, at most, along each side
_FINEST = 2000
# pixels that things are grown by, and the share of heights below a thing's top
_EDGE, _TOP = 2.0, 0.9


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Something that stands on the table and is no rope.

    Attributes
    ----------
    view : int
        The view that saw it.
    place : (3,) ndarray
        Its middle, as seen, in the world frame, metres.
    reason : str
    """

    view: int
    place: Array
    reason: str


def rope_strips(
    top: Tabletop, thin: float, thick: float, view: int
) -> tuple[NDArray[np.bool_], list[LeftOut]]:
    """Return the pixels that may be ropes of some radii standing on a table, and what else stands there.

    What is wider than two strands and higher than ropes pile up is a thing, and so is what is wide below it.

    Parameters
    ----------
    top : Tabletop
    thin, thick : float
        The least and the greatest radius of the ropes, metres.
    view : int
        Its number, for what is left out.

    Returns
    -------
    mask : (H, W) ndarray of bool
    left_out : list of LeftOut
    """
    image = replace(top.image, mask=standing_out(top.image, (top.normal, top.offset), None, thin))
    wide = _opened(image, thick)
    things, numbers = np.zeros_like(wide), _core.blob_numbers(wide)
    left_out = []
    for rows, columns in _blobs(numbers):
        highest = float(np.quantile(top.above[rows, columns], _TOP))
        if highest > _PILE * thick:
            things[rows, columns] = True
            reason = f"wider than ropes of radius {1e3 * thick:.1f} mm, and {1e3 * highest:.0f} mm high"
            left_out.append(LeftOut(view, _middle(image, rows, columns), reason))
    things |= wide & _around(image, things, top.normal, thick)
    near = _core.edge_distances(~things, 8) if things.any() else np.full(wide.shape, np.inf)
    mask = image.mask & (near > _EDGE)
    lengths = strip_lengths(replace(image, mask=mask)) / thick
    for number, (rows, columns) in enumerate(_blobs(_core.blob_numbers(mask)), 1):
        length = float(lengths[number]) if number < len(lengths) else 0.0
        high = float(np.median(top.above[rows, columns])) / thick
        beside = bool((near[rows, columns] <= 2.0 * _EDGE).any())
        if length < _SPECK or (beside and (length < _SCRAP or (length < _SHORT and high > _HIGH))):
            mask[rows, columns] = False
            if beside and length >= _SPECK:
                reason = f"a thin piece, {1e3 * length * thick:.0f} mm long, of a thing beside it"
                left_out.append(LeftOut(view, _middle(image, rows, columns), reason))
    return mask, left_out


def _blobs(numbers: NDArray[np.int64]) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield the rows and columns of each blob, by its number."""
    rows, columns = np.nonzero(numbers)
    own = numbers[rows, columns]
    order = np.argsort(own, kind="stable")
    for part in np.split(order, np.flatnonzero(np.diff(own[order])) + 1):
        if len(part):
            yield rows[part], columns[part]


def _middle(image: RopeImage, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Array:
    z = image.depth[rows, columns]
    return np.asarray(np.median(image.world(rows, columns, z)[z > 0], axis=0))


def _opened(image: RopeImage, radius: float) -> NDArray[np.bool_]:
    """Pixels of a mask that lie in discs inside of it that are wider than crossing strands."""
    with np.errstate(divide="ignore"):
        reach = _WIDE * radius * image.focal[0] / image.depth
    core = image.mask & (_core.edge_distances(image.mask, sum(image.mask.shape)) - 0.5 > reach)
    if not core.any():
        return core
    return np.asarray(image.mask & (core | (_core.edge_distances(~core, sum(core.shape)) < reach + 0.5)))


def _around(image: RopeImage, things: NDArray[np.bool_], normal: Array, radius: float) -> NDArray[np.bool_]:
    """Pixels of the mask that lie below or close beside things, as seen from straight above the table."""
    found = np.zeros_like(things)
    if not things.any():
        return found
    rows, columns = np.nonzero(image.mask & (image.depth > 0))
    plan = image.world(rows, columns, image.depth[rows, columns]) @ in_plane(normal)
    margin = int(_BESIDE) + 1
    low, high = plan.min(axis=0), plan.max(axis=0)
    # a wrong unit may spread a view over kilometres
    side = max(radius, float((high - low).max()) / _FINEST)
    cells = np.floor((plan - low) / side).astype(np.int64) + margin
    grid = np.zeros(cells.max(axis=0) + margin + 1, dtype=bool)
    grid[tuple(cells[things[rows, columns]].T)] = True
    covered = grid | (_core.edge_distances(~grid, 8) <= _BESIDE)
    found[rows, columns] = covered[tuple(cells.T)]
    return found
