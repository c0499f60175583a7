"""The middle lines of a map's mask: arcs between the hubs where arcs meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_MAX_SPUR = 1.25  # length of arcs that are nothing but the mask's edge, half widths at the hub
_MAX_SHADOW = 2.0  # the same beside a strand that hides what is there
_CLEAR = 0.9  # share of the cells of an arc that are seen, beside no such strand
_MAX_LONELY = 6.0  # length of separate pieces that are dropped, least radii
_MIN_SEEN = 0.5  # share of the cells of an arc that ends freely: with less it is a shadow
_MIN_LOOP = 4.0  # length of loops that are no holes of noise, least radii
_ROUNDS = 8  # of pruning at most: each takes the spurs that the last one left

NO_HUB = -1
"""The hub of an arc's free end."""

End = tuple[int, int]
"""An arc's number, and 0 for its first or 1 for its last cell."""


@dataclass(frozen=True, eq=False)
class Arc:
    """A line of cells, and the hubs at its ends.

    Attributes
    ----------
    cells : (M, 2) ndarray
        Rows and columns in order.
    hubs : (int, int)
        Numbers of the hubs at its first and last cell; `NO_HUB` at a free end.
    """

    cells: Array
    hubs: tuple[int, int]

    def from_end(self, end: int) -> Array:
        """Return the cells from the first (0) or the last one (1) on."""
        return self.cells[::-1] if end else self.cells


@dataclass(frozen=True, eq=False)
class Lines:
    """Arcs and hubs.

    Attributes
    ----------
    hubs : (K, 2) ndarray
        Row and column of each hub.
    arcs : list of Arc
    """

    hubs: Array
    arcs: list[Arc]

    def list_ends(self, hub: int) -> list[End]:
        """Return the ends of arcs at a hub."""
        return [
            (number, end) for number, arc in enumerate(self.arcs) for end in (0, 1) if arc.hubs[end] == hub
        ]


def trace_lines(drawn: SurfaceMap, radius: float) -> Lines:
    """Thin a map's mask to lines without spurs; `radius` is the least, metres."""
    hubs, traced = _core.trace_skeleton(drawn.mask)
    lines = _join_passing(hubs, [Arc(cells.astype(np.float64), ends) for cells, ends in traced])
    for _ in range(_ROUNDS):
        kept = [arc for arc in lines.arcs if not _is_spur(arc, lines, drawn, radius)]
        if len(kept) == len(lines.arcs) or not kept:
            break
        lines = _join_passing(lines.hubs, kept)
    return lines


def _join_passing(hubs: Array, arcs: list[Arc]) -> Lines:
    """Join the two arcs at each hub where no third one ends: thinning leaves such corners."""
    arcs = list(arcs)
    for hub in range(len(hubs)):
        ends = [(arc, end) for arc in arcs for end in (0, 1) if arc.hubs[end] == hub]
        if len(ends) == 1:
            ((arc, end),) = ends
            freed = (NO_HUB, arc.hubs[1]) if end == 0 else (arc.hubs[0], NO_HUB)
            arcs[_place(arcs, arc)] = Arc(arc.cells, freed)
        elif len(ends) == 2 and ends[0][0] is not ends[1][0]:
            (first, end), (second, other) = ends
            cells = np.concatenate([first.from_end(1 - end), hubs[hub : hub + 1], second.from_end(other)])
            joined = Arc(cells, (first.hubs[1 - end], second.hubs[1 - other]))
            arcs = [arc for arc in arcs if arc is not first and arc is not second] + [joined]
    used = sorted({hub for arc in arcs for hub in arc.hubs if hub != NO_HUB})
    numbers = {hub: number for number, hub in enumerate(used)} | {NO_HUB: NO_HUB}
    arcs = [Arc(arc.cells, (numbers[arc.hubs[0]], numbers[arc.hubs[1]])) for arc in arcs]
    return Lines(hubs[used].reshape(-1, 2), arcs)


def _place(arcs: list[Arc], wanted: Arc) -> int:
    return next(number for number, arc in enumerate(arcs) if arc is wanted)


def _is_spur(arc: Arc, lines: Lines, drawn: SurfaceMap, radius: float) -> bool:
    """Tell whether an arc that ends freely, or a loop, is too short to be a rope, or nothing but a shadow."""
    free = arc.hubs.count(NO_HUB)
    length = measure_length(arc.cells)
    if free == 0:
        return arc.hubs[0] == arc.hubs[1] and length * drawn.cell < _MIN_LOOP * radius
    if free == 2:
        return length * drawn.cell < _MAX_LONELY * radius
    # a shadow reaches to the end, but a strand comes out of it
    outer = arc.from_end(arc.hubs.index(NO_HUB))
    seen = drawn.share_seen(outer[: len(outer) // 2 + 1])
    length /= max(float(drawn.sample_widths(lines.hubs[max(arc.hubs)][None])[0]), 1.0)
    return seen < _MIN_SEEN or length < (_MAX_SPUR if seen > _CLEAR else _MAX_SHADOW)


def measure_length(cells: Array) -> float:
    """Return the length of a line of cells, cells."""
    return float(np.linalg.norm(np.diff(cells, axis=0), axis=1).sum())
