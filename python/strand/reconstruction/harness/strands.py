"""Strands: arcs followed through crossings from node to node, and lifted to the height of the ropes' axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count, pairwise

import numpy as np

import strand._core as _core
from strand.geometry.polyline import path_length
from strand.reconstruction.harness.lines import NO_HUB, End, Lines
from strand.reconstruction.harness.places import Decisions, Passing
from strand.reconstruction.harness.ports import measure_along
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_SPACING = 0.35  # distance of a strand's nodes, half widths
_SMOOTHING = 0.75  # standard deviation of the smoothing along a strand, half widths
_BENT_LINE = (
    1.2  # distance from where strands merge up to which the mask's middle line bends to it, half widths
)
_BENT_BY = 1.2  # the same where the other strand is thicker, half widths of the mask there
_HIDDEN = 2.6  # distance from a crossing up to which the upper strand hides the lower one, half widths
_BESIDE = 1.5  # the same beside the stretch where both merge, half widths
_QUARTERS = 4  # of a strand, whose widths are compared
_AXIS = 0.93  # depth of the axis below the smoothed surface, heights of the ridge
_TOO_THICK = 2.0  # half widths: no radius of a strand
_TIP = 3.0  # length of the stretch that tells where an end points, half widths
_MAX_TIP = 60  # steps of half a cell from an end to the mask's edge at most
_FARTHEST = 5.0  # distance from the end of a traced tube to that of the mask at most, radii
_SAME_HEIGHT = 0.7  # difference of heights of one strand at most, radii
_FEWEST = 4  # nodes of a strand at least
_FEWEST_INSIDE = 8  # nodes between its ends that tell its width at least
_SAME_PLACE = 1.0  # length of a strand between two junctions that are one place at most, half widths
_TIGHTEST_RING = 10.0  # length of a ring at least, half widths
_TIGHTEST = 5.0  # length of a strand from a junction to itself at least, half widths


ENDS = 4.0
"""Length of the stretches at a strand's ends that do not tell its width, half widths."""

WIDER = 1.5
"""Width of a part of a strand over that of another one that shows that it holds two strands."""


@dataclass(frozen=True, eq=False)
class Strand:
    """A stretch of rope from node to node.

    Attributes
    ----------
    nodes : (M, 3) ndarray
        Its axis, world frame, metres.
    ends : (int or None, int or None)
        Numbers of the junctions at its first and last node; None at a free end, and at both of a ring.
    half_width : float
        Median half width of its mask, metres.
    closed : bool
        Whether it is a ring without a junction.
    """

    nodes: Array
    ends: tuple[int | None, int | None]
    half_width: float
    closed: bool


def list_pairs(strands: Sequence[Strand], junctions: int) -> list[tuple[int, int]]:
    """Return the nodes at which each strand starts and stops; free ends count on from the junctions."""
    free = count(junctions)
    pairs = []
    for strand in strands:
        first, last = (next(free) if end is None else end for end in strand.ends)
        pairs.append((first, last))
    return pairs


def follow_strands(lines: Lines, decided: Decisions, drawn: SurfaceMap, radii: Array | None) -> list[Strand]:
    """Return the strands between the nodes.

    Parameters
    ----------
    lines : Lines
    decided : Decisions
    drawn : SurfaceMap
    radii : (K,) ndarray or None
        The radii that ropes may have, metres.
    """
    onward: dict[End, tuple[End, Passing]] = {}
    for passing in decided.passings:
        first, second = passing.ends
        onward[first], onward[second] = (second, passing), (first, passing)
    junction_at = {end: number for number, junction in enumerate(decided.junctions) for end in junction.ends}
    laid_at = {laid.end: laid for laid in decided.laid}
    seen: set[int] = set(decided.inner)
    starts = [(arc, end) for arc in range(len(lines.arcs)) for end in (0, 1) if (arc, end) not in onward]
    starts += [(arc, 0) for arc in range(len(lines.arcs))]
    strands = []
    for start in starts:
        if start[0] in seen:
            continue
        pieces, passed, stop = _follow(start, lines, onward, seen)
        cells, gaps = _bridge(pieces, passed, drawn)
        is_alone = lines.arcs[start[0]].hubs == (NO_HUB, NO_HUB) and len(pieces) == 1
        closed = start in onward or (is_alone and _is_ring(pieces[0]))
        ends: list[int | None] = [None, None]
        under: list[Array] = []
        for place, end in enumerate((start, stop)):
            backwards = cells[::-1] if place == 0 else cells
            if closed:
                continue
            if end in junction_at:
                ends[place] = junction_at[end]
                extended = _lead_to(backwards, decided.junctions[junction_at[end]].place)
            elif end in laid_at:
                extended = np.vstack([backwards, laid_at[end].place])
                if laid_at[end].under:
                    under.append(extended[-2:])
            else:
                extended = _reach_edge(backwards, drawn)
            cells = extended[::-1] if place == 0 else extended
        hidden = [gap for gap, passing in gaps if passing.is_below]
        strands.append(_lift(cells, hidden, under, (ends[0], ends[1]), closed, drawn, radii))
    return [strand for strand in strands if not (strand.closed and _is_tight(strand))]


def _is_tight(ring: Strand) -> bool:
    """Tell whether a ring is no rope, but the edge of a hole in a wide place."""
    return float(path_length(ring.nodes)[-1]) < _TIGHTEST_RING * ring.half_width


def drop_collapsed(strands: Sequence[Strand]) -> list[Strand]:
    """Return strands without those too short to lie between junctions; both junctions become one."""
    merged: dict[int, int] = {}
    kept = []
    for strand in strands:
        first, last = strand.ends
        if first is None or last is None:
            kept.append(strand)
            continue
        length = float(path_length(strand.nodes)[-1])
        if length > (_TIGHTEST if first == last else _SAME_PLACE) * strand.half_width:
            kept.append(strand)
            continue
        one, other = sorted(merged.get(end, end) for end in (first, last))
        merged = {end: one if now == other else now for end, now in {**merged, other: other}.items()}
    if len(kept) == len(strands):
        return list(strands)
    ends = [tuple(None if end is None else merged.get(end, end) for end in strand.ends) for strand in kept]
    return [replace(strand, ends=(pair[0], pair[1])) for strand, pair in zip(kept, ends, strict=True)]


def _follow(
    start: End, lines: Lines, onward: dict[End, tuple[End, Passing]], seen: set[int]
) -> tuple[list[Array], list[Passing], End]:
    """Follow arcs through crossings; return their cells, the crossings, and the last end."""
    pieces: list[Array] = []
    passed: list[Passing] = []
    number, end = start
    while True:
        seen.add(number)
        pieces.append(lines.arcs[number].from_end(end))
        stop = (number, 1 - end)
        following = onward.get(stop)
        if following is None:
            return pieces, passed, stop
        passed.append(following[1])
        if following[0][0] in seen:
            return pieces, passed, stop
        number, end = following[0]


def _bridge(
    pieces: list[Array], passed: list[Passing], drawn: SurfaceMap
) -> tuple[Array, list[tuple[Array, Passing]]]:
    """Return pieces in one, which go straight on where another strand bends the mask's middle line.

    The cells (2, 2) on both sides of each such stretch come with it, and the crossing there.
    """
    kept = [pieces[0]]
    for piece, passing in zip(pieces[1:], passed, strict=False):
        kept[-1] = _leave_out(kept[-1][::-1], passing, drawn)[::-1]
        kept.append(_leave_out(piece, passing, drawn))
    sides = [np.stack([before[-1], after[0]]) for before, after in pairwise(kept)]
    gaps = list(zip(sides, passed, strict=False))
    if len(passed) == len(pieces):
        # where a ring closes, both sides are ends of the line
        gaps += [(np.stack([cell, cell]), passed[-1]) for cell in (kept[0][0], kept[-1][-1])]
    return np.concatenate(kept), gaps


def _leave_out(cells: Array, passing: Passing, drawn: SurfaceMap) -> Array:
    """Return cells without the first ones, which are too near to a crossing."""
    own, merged = float(np.median(drawn.sample_widths(cells))), float(drawn.sample_widths(cells[:1])[0])
    reach = float(np.linalg.norm(cells[0] - passing.middle)) + max(_BENT_LINE * own, _BENT_BY * merged)
    away = np.linalg.norm(cells - passing.middle, axis=1)
    away = np.maximum.accumulate(away)
    first = int((away > reach).argmax()) if away[-1] > reach else len(cells) - 1
    return cells[min(first, len(cells) // 2) :]


def _is_ring(cells: Array) -> bool:
    return len(cells) > 8 and float(np.abs(cells[0] - cells[-1]).max()) <= 2.0


def _lead_to(cells: Array, place: Array) -> Array:
    """Return cells that end at a place: cut where they pass nearest to it, then led to it."""
    # the other half of a loop may start at the same place
    half = len(cells) // 2
    nearest = half + int(np.linalg.norm(cells[half:] - place, axis=1).argmin())
    kept = cells[: nearest + 1] if nearest > 1 else cells
    return np.vstack([kept, place])


def _reach_edge(cells: Array, drawn: SurfaceMap) -> Array:
    """Return cells that go on to the mask's edge."""
    tip = cells[-1]
    back = min(len(cells) - 1, int(_TIP * float(drawn.sample_widths(tip[None])[0])) + 3)
    direction = tip - cells[-1 - back]
    direction = direction / max(float(np.linalg.norm(direction)), 1e-9)
    place = tip.copy()
    for _ in range(_MAX_TIP):
        if not drawn.holds(place + 0.5 * direction):
            break
        place = place + 0.5 * direction
    return np.vstack([cells, place])


def reach_edges(strands: Sequence[Strand], drawn: SurfaceMap) -> list[Strand]:
    """Return strands whose free ends go on to the mask's edge, while the surface keeps its height.

    They end where they would run into another strand.
    """
    reached = []
    for number, strand in enumerate(strands):
        nodes = strand.nodes
        others = [other.nodes for place, other in enumerate(strands) if place != number]
        for late in (0, 1):
            if strand.ends[late] is None and not strand.closed:
                along = path_length(strand.nodes)
                away = along[-1] - along if late else along
                own = strand.nodes[away > 2.0 * _FARTHEST * strand.half_width]
                end = _find_edge(strand, late, np.concatenate([own, *others]), drawn)
                nodes = nodes if end is None else np.concatenate([nodes, end] if late else [end, nodes])
        reached.append(replace(strand, nodes=nodes))
    return reached


def _find_edge(strand: Strand, late: int, others: Array, drawn: SurfaceMap) -> Array | None:
    """Return the place (1, 3) where the straight way on from an end leaves the mask, metres."""
    nodes, half = strand.nodes[:: -1 if late else 1], strand.half_width
    away = np.linalg.norm(nodes - nodes[0], axis=1)
    inner = nodes[min(int(away.searchsorted(_TIP * half)), len(nodes) - 1)]
    outward = (nodes[0] - inner) / max(float(np.linalg.norm(nodes[0] - inner)), 1e-12)
    ahead = nodes[0] + np.arange(0.0, _FARTHEST * half, 0.5 * drawn.cell)[:, None] * outward
    places, heights = drawn.flatten(ahead)
    surface = drawn.sample_heights(places) - heights
    gone = ~drawn.hold(places) | (np.abs(surface - surface[0]) > _SAME_HEIGHT * half)
    if len(others):
        gone |= _core.find_squared_distances(ahead, others) < half**2
    if not gone.any() or gone[:2].any():
        return None
    return np.asarray(ahead[int(gone.argmax()) - 1][None])


def _lift(
    cells: Array,
    gaps: list[Array],
    under: list[Array],
    ends: tuple[int | None, int | None],
    closed: bool,
    drawn: SurfaceMap,
    radii: Array | None,
) -> Strand:
    """Smooth a strand in the plan, and lift it by the height of the ridge.

    It is hidden in `gaps`, each between two cells (2, 2), and near the last cell in each of `under` (2, 2).
    """
    along = measure_along(cells)
    half = max(float(np.median(drawn.sample_widths(cells))), 1.0)
    places = np.linspace(0.0, along[-1], max(int(along[-1] / (_SPACING * half)), _FEWEST))
    plan = np.column_stack([np.interp(places, along, cells[:, axis]) for axis in (0, 1)])
    deviation = _SMOOTHING * half / max(places[1] - places[0], 1e-9)
    smooth = smooth_nodes(plan, deviation)
    smooth[[0, -1]] = plan[[0, -1]]
    inside = (places > ENDS * half) & (places < places[-1] - ENDS * half)
    widths = drawn.sample_widths(smooth)
    usual = _measure_width(widths[inside]) if inside.sum() > _FEWEST_INSIDE else float(np.median(widths))
    half_width = drawn.cell * usual
    radius = half_width if radii is None else float(radii[np.abs(radii - half_width).argmin()])
    radius = half_width if radius > _TOO_THICK * half_width else radius
    heights = drawn.sample_heights(smooth)
    hidden = np.zeros(len(places), dtype=bool)
    for gap in gaps:
        first, last = places[np.linalg.norm(smooth - gap[:, None], axis=2).argmin(axis=1)]
        reach = max(_HIDDEN * half, 0.5 * (last - first) + _BESIDE * half)
        hidden |= np.abs(places - 0.5 * (first + last)) < reach
    for last, tip in under:
        reach = _HIDDEN * half + float(np.linalg.norm(last - tip))
        hidden |= np.linalg.norm(smooth - tip, axis=1) < reach
    if (~hidden).sum() >= _FEWEST:
        heights = np.interp(places, places[~hidden], take_medians(heights[~hidden], 5))
    heights = smooth_nodes(heights[:, None], deviation)[:, 0] - _AXIS * drawn.ridge * radius
    return Strand(drawn.lift(smooth, heights), ends, half_width, closed)


def _measure_width(widths: Array) -> float:
    """Return the usual half width; that of the narrowest part if the others hold another strand, too."""
    # beside the mask a strand still has some width
    parts = measure_parts(np.maximum(widths, 1.0))
    return min(parts) if max(parts) > WIDER * min(parts) else float(np.median(widths))


def measure_parts(widths: Array) -> list[float]:
    """Return the median half width of each quarter of a strand, of which some may hold another one, too."""
    return [float(np.median(part)) for part in np.array_split(widths, _QUARTERS)]


def smooth_nodes(values: Array, deviation: float) -> Array:
    """Return values (M, K) smoothed along the first axis by a Gaussian; ends are repeated beyond."""
    reach = max(int(np.ceil(3.0 * deviation)), 1)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(deviation, 1e-3)) ** 2)
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="edge")
    return np.column_stack([np.convolve(column, kernel / kernel.sum(), mode="valid") for column in padded.T])


def take_medians(values: Array, count: int) -> Array:
    """Return the median of an odd number of neighbours of each value."""
    padded = np.pad(values, count // 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, count), axis=1))
