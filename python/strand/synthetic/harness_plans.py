"""Plans of harnesses: random trees and cycles on the table z = 0, and the heights of strands that cross."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand.support.checks import Array

STEP = 0.002
"""Distance of the nodes of a plan, metres."""

_LENGTHS = (0.07, 0.15)  # metres: range of an edge's length
_HALF = 0.21  # metres: half of the square that holds a plan
_GAP = 1.5  # sums of two radii: least distance of strands that do not cross
_RAMP = 5.0  # sums of two radii along a strand that is lifted over another
_RAMP_PER_SINE = 2.0  # of these for a crossing at an angle, over its sine
_PACKING = 1.02  # sums of two radii between the axes of strands that cross
_NODE_REACH = 8.0  # radii of the thickest edge at a node, in which the others come down to the table
_TURNS = math.radians(60.0)  # radians: most that half an edge turns
_ROUNDS = 10  # of lifting strands over others that are lifted themselves
_MAX_RISE = 0.05  # metres: highest strand


@dataclass(frozen=True, eq=False)
class Piece:
    """An edge in plan: the nodes where it starts and stops, its line, its radius and its wires."""

    start: int
    stop: int
    line: Array  # (M, 2) or, once laid, (M, 3); metres
    radius: float  # metres
    wires: int | None

    @property
    def at(self) -> Array:
        """Arc length of each node in plan, metres."""
        return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.line[:, :2], axis=0).T))])


@dataclass(frozen=True)
class Meeting:
    """Two strands that cross in plan: the upper and the lower piece, the nodes of each, the angle's sine."""

    upper: int
    at_upper: int
    lower: int
    at_lower: int
    sine: float


def trace(
    rng: np.random.Generator, place: Array, heading: float, length: float, turns: float = _TURNS
) -> Array:
    """Return the (M, 2) nodes of a bend that starts somewhere with a heading; it bends least at its ends."""
    count = max(int(length / STEP), 4)
    s = (np.arange(count) + 0.5) / count
    one, two = rng.uniform(-turns, turns, 2)
    headings = heading + one * 0.5 * (1.0 - np.cos(np.pi * s)) + 0.5 * two * (1.0 - np.cos(2.0 * np.pi * s))
    steps = length / count * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.vstack([place, place + np.cumsum(steps, axis=0)])


def find_heading(line: Array) -> float:
    """Return the heading at the end of a line, radians."""
    return math.atan2(*(line[-1] - line[-2])[[1, 0]])


def grow_tree(
    rng: np.random.Generator,
    junctions: int,
    find_radius: Callable[[int], float],
    *,
    counted: bool = True,
    most: int = 3,
    four: bool = False,
    angles: tuple[float, float] = (math.radians(40.0), math.radians(80.0)),
    turns: float = _TURNS,
) -> list[Piece]:
    """Return the edges of a random tree in which the thickest branch goes on straight at each junction.

    `find_radius` gives the radius of an edge with a number of wires, metres; with `counted`, edges know this
    number. A branch ends with at most `most` wires. With `four`, the first junction has four edges. `angles`
    is the range of those at which branches leave, and half an edge turns by at most `turns`, radians.
    """
    parents, leaves, count = [0], [1], 2
    children: dict[int, list[int]] = {0: [1]}
    for number in range(junctions):
        chosen = leaves.pop(int(rng.integers(len(leaves))))
        children[chosen] = list(range(count, count + (3 if four and number == 0 else 2)))
        count += len(children[chosen])
        leaves += children[chosen]
        parents.append(chosen)
    wires = np.zeros(count, int)
    wires[leaves] = 1 if len(leaves) > 3 else rng.integers(1, most + 1, len(leaves))
    for node in sorted(children, reverse=True):
        wires[node] = wires[children[node]].sum()
    pieces: list[Piece] = []
    ends = {0: (np.zeros(2), float(rng.uniform(-math.pi, math.pi)))}
    for node in sorted(children):
        place, heading = ends[node]
        ordered = sorted(children[node], key=lambda child: (-wires[child], rng.random()))
        sides = [0.0, *(rng.choice([-1.0, 1.0]) * np.array([1.0, -1.0]))][: len(ordered)]
        for child, side in zip(ordered, sides, strict=True):
            leaves_at = heading + side * float(rng.uniform(*angles))
            line = trace(rng, place, leaves_at, rng.uniform(*_LENGTHS), turns)
            number = int(wires[child])
            pieces.append(Piece(node, child, line, find_radius(number), number if counted else None))
            ends[child] = (line[-1], find_heading(line))
    return pieces


def grow_cycle(rng: np.random.Generator, radius: float) -> list[Piece]:
    """Return two branches that part at one junction and meet again at another, with a trunk on each side."""
    wires = rng.integers(1, 4, 2)
    whole, reach = int(wires.sum()), float(rng.uniform(0.09, 0.13))
    s = np.linspace(0.0, 1.0, int(1.4 * reach / STEP))
    pieces = []
    # the thicker branch goes on nearly straight
    for count, bulge in zip(
        sorted(wires.tolist()), (rng.uniform(0.4, 0.6), -rng.uniform(0.0, 0.1)), strict=True
    ):
        line = reach * np.stack([s, bulge * np.sin(np.pi * s)], axis=1)
        pieces.append(Piece(1, 2, line, radius * math.sqrt(count), count))
    before = trace(rng, np.zeros(2), math.pi, rng.uniform(*_LENGTHS))[::-1]
    after = trace(rng, np.array([reach, 0.0]), 0.0, rng.uniform(*_LENGTHS))
    thick = radius * math.sqrt(whole)
    return [Piece(0, 1, before, thick, whole), *pieces, Piece(2, 3, after, thick, whole)]


def add_rope(
    rng: np.random.Generator, pieces: list[Piece], radius: float, *, near: bool = False, laid: bool = False
) -> list[Piece]:
    """Return the edges and a loose rope across one of them.

    With `near` it crosses close to a junction, or at a small angle. With `laid` it ends just beyond.
    """
    chosen = pieces[int(rng.integers(len(pieces)))]
    at = chosen.at
    angle = float(rng.uniform(math.radians(55.0), math.radians(90.0)))
    s = float(rng.uniform(0.3, 0.7)) * at[-1]
    if near and rng.random() < 0.5:
        angle = float(rng.uniform(math.radians(20.0), math.radians(35.0)))
    elif near:
        s = float(rng.uniform(4.0, 8.0)) * chosen.radius
        s = s if sum(chosen.start in (piece.start, piece.stop) for piece in pieces) > 2 else at[-1] - s
    node = int(np.clip(np.searchsorted(at, s), 1, len(at) - 2))
    heading = find_heading(chosen.line[: node + 1]) + rng.choice([-1.0, 1.0]) * angle
    turns = 0.3 * _TURNS
    back = trace(rng, chosen.line[node], heading + math.pi, rng.uniform(*_LENGTHS), turns)
    beyond = float(rng.uniform(0.8, 2.0)) * radius if laid else float(rng.uniform(*_LENGTHS))
    ahead = trace(rng, chosen.line[node], heading, max(beyond, 2.0 * STEP), turns)
    first = 1 + max(max(piece.start, piece.stop) for piece in pieces)
    wires = None if chosen.wires is None else 1
    return [*pieces, Piece(first, first + 1, np.vstack([back[:0:-1], ahead]), radius, wires)]


def fit_in_square(pieces: Sequence[Piece]) -> list[Piece] | None:
    """Return the edges with their middle at the origin; None if they reach too far."""
    nodes = np.concatenate([piece.line for piece in pieces])
    middle = 0.5 * (nodes.min(axis=0) + nodes.max(axis=0))
    if np.abs(nodes - middle).max() > _HALF:
        return None
    return [replace(piece, line=piece.line - middle) for piece in pieces]


def find_meetings(rng: np.random.Generator, pieces: Sequence[Piece], last_on_top: bool) -> list[Meeting]:
    """Return all crossings in plan, with a random strand on top, or the last one."""
    found = []
    for i, one in enumerate(pieces):
        for j in range(i, len(pieces)):
            a, b = one.line, pieces[j].line
            step, other = np.diff(a, axis=0)[:, None], np.diff(b, axis=0)[None]
            offset = b[None, :-1] - a[:-1, None]
            size = step[..., 0] * other[..., 1] - step[..., 1] * other[..., 0]
            with np.errstate(divide="ignore", invalid="ignore"):
                t = (offset[..., 0] * other[..., 1] - offset[..., 1] * other[..., 0]) / size
                u = (offset[..., 0] * step[..., 1] - offset[..., 1] * step[..., 0]) / size
            meet = (t >= 0) & (t < 1) & (u >= 0) & (u < 1)
            for p, q in np.argwhere(meet).tolist():
                if i == j and q - p < 4:
                    continue
                ends = _list_shared(one, pieces[j], p, q) if i != j else []
                if any(reach < 4 for reach in ends):
                    continue  # they meet at their node
                sine = abs(float(size[p, q])) / float(
                    np.linalg.norm(step[p, 0]) * np.linalg.norm(other[0, q])
                )
                upper_first = rng.random() < 0.5 and not (last_on_top and j == len(pieces) - 1)
                pair = (i, p, j, q) if upper_first else (j, q, i, p)
                found.append(Meeting(*pair, sine))
    return found


def _list_shared(one: Piece, other: Piece, p: int, q: int) -> list[int]:
    """Return the numbers of nodes between a place on each piece and each node that they share."""
    return [
        max(p if end == "start" else len(one.line) - 1 - p, q if far == "start" else len(other.line) - 1 - q)
        for end in ("start", "stop")
        for far in ("start", "stop")
        if getattr(one, end) == getattr(other, far)
    ]


def lay(pieces: Sequence[Piece], meetings: Sequence[Meeting], table: bool) -> list[Piece] | None:
    """Return the edges with heights: on the table or in one plane, and lifted over those that they cross.

    Edges share the height of their node. None if a strand comes too high or too near to another.
    """
    thickest: dict[int, float] = {}
    for piece in pieces:
        for end in (piece.start, piece.stop):
            thickest[end] = max(thickest.get(end, 0.0), piece.radius)
    bases = [_find_base(piece, thickest, table) for piece in pieces]
    distances = [_measure_ways(pieces, meeting.upper, meeting.at_upper) for meeting in meetings]
    heights = [base.copy() for base in bases]
    for _ in range(_ROUNDS):
        lifts = [np.zeros(len(base)) for base in bases]
        for meeting, ways in zip(meetings, distances, strict=True):
            both = pieces[meeting.upper].radius + pieces[meeting.lower].radius
            top = heights[meeting.lower][meeting.at_lower] + _PACKING * both
            rise = max(top - bases[meeting.upper][meeting.at_upper], 0.0)
            reach = (_RAMP + _RAMP_PER_SINE / meeting.sine) * both
            for lift, way in zip(lifts, ways, strict=True):
                # the sum of fourth powers is a smooth maximum
                lift += (rise * np.clip(1.0 - (way / reach) ** 2, 0.0, None) ** 3) ** 4
        heights = [base + lift**0.25 for base, lift in zip(bases, lifts, strict=True)]
        if max(height.max() for height in heights) > _MAX_RISE:
            return None
    laid = [
        replace(piece, line=np.column_stack([piece.line, height]))
        for piece, height in zip(pieces, heights, strict=True)
    ]
    return laid if _are_apart(laid) else None


def _find_base(piece: Piece, thickest: dict[int, float], table: bool) -> Array:
    """Return the heights of an edge that nothing lifts: its axis comes down from those of its nodes."""
    if not table:
        return np.zeros(len(piece.line))
    at, base = piece.at, np.full(len(piece.line), piece.radius)
    for end, away in ((piece.start, at), (piece.stop, at[-1] - at)):
        t = np.clip(away / min(_NODE_REACH * thickest[end], 0.5 * at[-1]), 0.0, 1.0)
        base += (thickest[end] - piece.radius) * (1.0 - t * t * (3.0 - 2.0 * t))
    return base


def _measure_ways(pieces: Sequence[Piece], number: int, node: int) -> list[Array]:
    """Return the length of the way along edges from a place on one to each node of all, metres."""
    own = pieces[number].at
    ways = [np.full(len(piece.line), np.inf) for piece in pieces]
    ways[number] = np.abs(own - own[node])
    far = {pieces[number].start: float(own[node]), pieces[number].stop: float(own[-1] - own[node])}
    for _ in range(len(pieces)):
        for k, piece in enumerate(pieces):
            at = piece.at
            for end, away in ((piece.start, at), (piece.stop, at[-1] - at)):
                if end in far:
                    ways[k] = np.minimum(ways[k], far[end] + away)
            for end, way in ((piece.start, ways[k][0]), (piece.stop, ways[k][-1])):
                far[end] = min(far.get(end, np.inf), float(way))
    return ways


def _are_apart(pieces: Sequence[Piece]) -> bool:
    """Tell whether strands keep their distance, but near a node that they share, and nothing cuts in."""
    for i, one in enumerate(pieces):
        for j in range(i, len(pieces)):
            other = pieces[j]
            gaps = np.linalg.norm(one.line[:, None] - other.line[None], axis=2)
            both = one.radius + other.radius
            if i == j:
                away = np.abs(one.at[:, None] - one.at[None]) > 2.5 * both
            else:
                away = np.ones(gaps.shape, dtype=bool)
                for end, reach in ((one.start, one.at), (one.stop, one.at[-1] - one.at)):
                    for far, other_reach in (
                        (other.start, other.at),
                        (other.stop, other.at[-1] - other.at),
                    ):
                        if end == far:
                            away &= np.maximum(reach[:, None], other_reach[None]) > 8.0 * both
            if (gaps[away] < 0.98 * both).any():
                return False
    return True


def keep_apart_in_plan(pieces: Sequence[Piece], meetings: Sequence[Meeting]) -> bool:
    """Tell whether strands are near each other in plan only where they cross, or share a node."""
    for i, one in enumerate(pieces):
        for j in range(i, len(pieces)):
            other = pieces[j]
            both = one.radius + other.radius
            gaps = np.linalg.norm(one.line[:, None] - other.line[None], axis=2)
            near = gaps < _GAP * both
            if i == j:
                near &= np.abs(one.at[:, None] - one.at[None]) > 5.0 * both
            for end, reach in ((one.start, one.at), (one.stop, one.at[-1] - one.at)):
                for far, other_reach in ((other.start, other.at), (other.stop, other.at[-1] - other.at)):
                    if i != j and end == far:
                        near &= np.maximum(reach[:, None], other_reach[None]) > 8.0 * both
            for meeting in meetings:
                for k, p, q in (
                    (meeting.upper, meeting.at_upper, meeting.at_lower),
                    (meeting.lower, meeting.at_lower, meeting.at_upper),
                ):
                    pair = {meeting.upper, meeting.lower}
                    if pair == {i, j} and k == i:
                        reach_here = (_GAP + 1.0) * both / meeting.sine
                        near &= ~(
                            (np.abs(one.at - one.at[p]) < reach_here)[:, None]
                            & (np.abs(other.at - other.at[q]) < reach_here)[None]
                        )
            if near.any():
                return False
    return True
