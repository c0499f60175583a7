"""Pulls that take ropes apart: ends go back over crossings and loops are lifted off, one by one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from strand.geometry.frames import check_direction
from strand.geometry.line import Line
from strand.ropes.crossings import Crossing
from strand.ropes.joints import Ends, is_joined
from strand.support.checks import Array

_BEYOND_CROSSING = 2.0  # both radii: how far a rope is moved beyond a crossing
_MIN_SINE = 0.25  # of the angle at a crossing under which an end is pulled out
_DIRECTIONS = 36  # tried directions of a straight tail
_LENGTH_SHARES = (1.0, 0.75, 0.5, 0.25)  # tried fractions of its length
_DRAG_EFFORT = 2.0  # effort of a way on which an end drags its rope, over that of a lifted one
_LIFT_EFFORT = 3.0  # effort of a strand that is lifted over an end and draws rope from both sides
_SLACK_EFFORT = 8.0  # effort of tail without room to lie straight, which may stay at the crossing
_MAX_CLEAR = 3.0  # radii: more distance from other strands does not make a way better
_SAMPLES = 50  # places along a stretch
_NO_LENGTH = 1e-9  # metres: a shorter vector has no direction


@dataclass(frozen=True, eq=False)
class Pull:
    """One move that undoes crossings.

    Attributes
    ----------
    undoes : tuple of Crossing
        One crossing, or the two of a loop.
    move : str
        "end": an end goes back over the crossing, or is pulled out beneath it. "loop": a stretch is lifted
        off another one, to the side or over its end.
    lift : bool
        Whether the moved strand is lifted over the other one. If not, it lies beneath and is pulled out along
        the table.
    chain : int
        Number of the moved chain.
    s : float
        Arc length of the place to hold, metres: an end, the middle of a loop, the place where a loop crosses
        an end, or just beyond the crossing where an end is pulled out.
    place : (3,) ndarray
        This place, world frame, metres.
    direction : (3,) ndarray
        Unit vector in which the place is moved, at right angles to the direction of view.
    distance : float
        How far it is moved, metres.
    slack : float
        Length of an end without room to lie straight, metres. It may stay at the crossing, and then needs
        another pull.
    """

    undoes: tuple[Crossing, ...]
    move: str
    lift: bool
    chain: int
    s: float
    place: Array
    direction: Array
    distance: float
    slack: float = 0.0

    def __str__(self) -> str:
        how = "lift" if self.lift else "pull out"
        way = ", ".join(f"{x:.2f}" for x in self.direction)
        return (
            f"{how} the {self.move} of chain {self.chain} at {self.s * 1e3:.0f} mm, "
            f"{self.distance * 1e3:.0f} mm along ({way})"
        )


@dataclass(frozen=True, eq=False)
class PullPlan:
    """Moves that take ropes apart.

    Attributes
    ----------
    pulls : tuple of Pull
        The moves in order. All are planned for the ropes as they lie now: look again after each.
    left : tuple of Crossing
        Crossings that remain: those of rings with each other or themselves, and of edges of a harness that
        end at junctions.
    """

    pulls: tuple[Pull, ...]
    left: tuple[Crossing, ...]

    def __str__(self) -> str:
        moves = [f"{number}. {pull}" for number, pull in enumerate(self.pulls, 1)]
        return "\n".join([*moves, f"{len(self.left)} crossings left"])


class _Pass(NamedTuple):
    """A strand at a crossing: the chain, the arc length, the crossing's number, whether it is on top."""

    chain: int
    s: float
    crossing: int
    over: bool


class _Way(NamedTuple):
    """A pull, and its cost, metres of way."""

    pull: Pull
    effort: float


def plan_pulls(
    chains: Sequence[Line], crossings: Sequence[Crossing], direction: ArrayLike, ends: Ends = ()
) -> PullPlan:
    """Plan the moves that take ropes apart, see `Model.pull_plan`."""
    towards = check_direction("direction", direction)
    left = dict(enumerate(crossings))
    pulls = []
    while left:
        passes = _list_passes(chains, left)
        ways = [*_plan_loops(chains, left, passes, towards), *_plan_ends(chains, left, passes, towards, ends)]
        if not ways:
            break
        # least effort for each undone crossing
        best = min(ways, key=lambda way: way.effort / len(way.pull.undoes)).pull
        pulls.append(best)
        left = {k: one for k, one in left.items() if not any(one is gone for gone in best.undoes)}
    return PullPlan(tuple(pulls), tuple(left.values()))


def _list_passes(chains: Sequence[Line], crossings: dict[int, Crossing]) -> list[list[_Pass]]:
    """Return the passes of each chain in order."""
    passes: list[list[_Pass]] = [[] for _ in chains]
    for k, one in crossings.items():
        for (chain, s), over in ((one.over, True), (one.under, False)):
            passes[chain].append(_Pass(chain, s, k, over))
    return [sorted(row, key=lambda each: each.s) for row in passes]


def _find_margin(chains: Sequence[Line], crossing: Crossing) -> float:
    """Return how far a rope goes beyond a crossing that it leaves, metres."""
    return _BEYOND_CROSSING * (chains[crossing.over[0]].radius + chains[crossing.under[0]].radius)


def _plan_loops(
    chains: Sequence[Line], crossings: dict[int, Crossing], passes: list[list[_Pass]], towards: Array
) -> list[_Way]:
    """Return moves that lift a stretch off one right below it (Reidemeister's second move)."""
    found = []
    beneath: dict[frozenset[int], list[tuple[int, float, float]]] = {}
    above = []
    for row, chain in zip(passes, chains, strict=True):
        pairs = list(pairwise(row))
        if chain.closed and len(row) > 1:
            pairs.append((row[-1], row[0]))
        for a, b in pairs:
            if a.over != b.over or a.crossing == b.crossing:
                continue
            length = (b.s - a.s) % chain.length if chain.closed else b.s - a.s
            if a.over:
                above.append((a, b, length))
            else:
                beneath.setdefault(frozenset((a.crossing, b.crossing)), []).append((a.chain, a.s, length))
    for a, b, length in above:
        both = crossings[a.crossing], crossings[b.crossing]
        chain = chains[a.chain]
        s = a.s + 0.5 * length
        s = s % chain.length if chain.closed else s
        place = chain.at(s)
        for lower in beneath.get(frozenset((a.crossing, b.crossing)), ()):
            way = _find_side(chains, lower, both, (a.chain, a.s, length), towards)
            # from the held place to beyond the whole lower stretch
            passed = max(float(((_sample_stretch(chains, *lower) - place) @ way).max()), 0.0)
            distance = passed + _find_margin(chains, both[0])
            pull = Pull(
                undoes=both,
                move="loop",
                lift=True,
                chain=a.chain,
                s=s,
                place=place,
                direction=way,
                distance=distance,
            )
            found.append(_Way(pull, distance))
    return found


def _sample_stretch(chains: Sequence[Line], which: int, start: float, length: float) -> Array:
    """Return places (N, 3) along a stretch of a chain."""
    chain = chains[which]
    s = start + np.linspace(0.0, length, _SAMPLES)
    return np.asarray(chain.at(s % chain.length if chain.closed else s))


def _find_side(
    chains: Sequence[Line],
    lower: tuple[int, float, float],
    both: tuple[Crossing, Crossing],
    upper: tuple[int, float, float],
    towards: Array,
) -> Array:
    """Return the unit vector (3,) from the upper to the lower of two stretches that cross twice."""
    chord = both[1].place - both[0].place
    across = np.cross(towards, chord)
    apart = _sample_stretch(chains, *lower).mean(axis=0) - _sample_stretch(chains, *upper).mean(axis=0)
    apart -= (apart @ towards) * towards
    length = float(np.linalg.norm(across))
    if length < min(chains[lower[0]].radius, chains[upper[0]].radius):
        # both crossings at one place: take the direction between the stretches' means
        across, length = apart, float(np.linalg.norm(apart))
    if length < _NO_LENGTH:
        # one stretch right above the other: any side will do
        tangent = chains[upper[0]].tangent_at(upper[1])
        across = np.cross(towards, tangent if abs(tangent @ towards) < 0.999 else tangent[[1, 2, 0]])
        length = float(np.linalg.norm(across))
    return np.asarray(across / length * (1.0 if across @ apart >= 0.0 else -1.0))


def _plan_ends(
    chains: Sequence[Line],
    crossings: dict[int, Crossing],
    passes: list[list[_Pass]],
    towards: Array,
    ends: Ends,
) -> list[_Way]:
    """Return moves that undo the crossing next to a free end: by the end, or by a strand lifted over it."""
    found = []
    for i, (row, chain) in enumerate(zip(passes, chains, strict=True)):
        if chain.closed or not row:
            continue
        for side, (first, end, inwards) in enumerate(((row[0], 0.0, 1.0), (row[-1], chain.length, -1.0))):
            if is_joined(ends, i, side):
                continue
            one = crossings[first.crossing]
            beyond = _find_margin(chains, one)
            if not first.over:
                # it is held there, clear of the other strand even at a flat angle
                beyond /= max(np.sin(one.angle), _MIN_SINE)
            turn = float(np.clip(first.s + inwards * beyond, 0.0, chain.length))
            tail = abs(first.s - end) + beyond
            way = _find_free_way(chains, i, turn, end, tail, inwards, towards)
            held = end if first.over else turn
            place, root = chain.at(held), chain.at(turn)
            move = root + way - place if first.over else way
            move -= (move @ towards) * towards
            distance = float(np.linalg.norm(move))
            slack = max(tail - float(np.linalg.norm(way)), 0.0)
            pull = Pull(
                undoes=(one,),
                move="end",
                lift=first.over,
                chain=i,
                s=held,
                place=place,
                direction=move / distance,
                distance=distance,
                slack=slack,
            )
            if not first.over:
                off = _plan_lift_over(chains, one, i, end, tail, towards)
                found += [] if off is None else [off]
            found.append(_Way(pull, distance * (1.0 if pull.lift else _DRAG_EFFORT) + _SLACK_EFFORT * slack))
    return found


def _plan_lift_over(
    chains: Sequence[Line], crossing: Crossing, which: int, end: float, tail: float, towards: Array
) -> _Way | None:
    """Return how the upper strand is lifted over the end of the lower one; None if others are in the way."""
    upper, s = crossing.over
    place, last = chains[upper].at(s), chains[which].at(end)
    way = last - place
    way -= (way @ towards) * towards
    length = float(np.linalg.norm(way))
    beyond = _find_margin(chains, crossing)
    if length < _NO_LENGTH:
        return None
    way /= length
    distance = length + beyond
    others = _sample_others(chains, [(which, end, tail), (upper, s, 2.0 * beyond)]) - place
    others -= np.outer(others @ towards, towards)
    away = np.linalg.norm(others - np.outer(np.clip(others @ way, 0.0, distance), way), axis=1)
    if away.min(initial=np.inf) < 2.0 * chains[upper].radius:
        return None
    pull = Pull(
        undoes=(crossing,),
        move="loop",
        lift=True,
        chain=upper,
        s=s,
        place=place,
        direction=way,
        distance=distance,
    )
    return _Way(pull, _LIFT_EFFORT * distance)


def _sample_others(chains: Sequence[Line], skipped: Sequence[tuple[int, float, float]]) -> Array:
    """Return places (N, 3) on all chains, a radius apart, without the skipped stretches.

    A skipped stretch is a chain number, an arc length, and a reach to both sides, metres.
    """
    found = []
    for i, each in enumerate(chains):
        s = np.arange(0.0, each.length, each.radius)
        for which, at, reach in skipped:
            if which == i:
                s = s[np.abs(s - at) > reach + 4.0 * each.radius]
        found.append(each.at(s).reshape(-1, 3))
    return np.concatenate(found)


def _find_free_way(
    chains: Sequence[Line],
    which: int,
    turn: float,
    end: float,
    tail: float,
    inwards: float,
    towards: Array,
) -> Array:
    """Return the vector (3,) of a straight tail from `turn` that lies clear of all strands, seen from above.

    It is shorter than the tail if there is no room for all of it.
    """
    chain = chains[which]
    back = inwards * chain.tangent_at(turn)
    back -= (back @ towards) * towards
    length = float(np.linalg.norm(back))
    # a rope along the direction of view has no direction in projection
    back = back / length if length > _NO_LENGTH else np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    back /= np.linalg.norm(back)
    aside = np.cross(towards, back)
    basis = np.stack([back, aside], axis=1)
    # the tail moves along, with what is next to it
    strands = (_sample_others(chains, [(which, end, abs(end - turn))]) - chain.at(turn)) @ basis
    # straight back first, as the first of equals is kept
    angles = np.linspace(-np.pi, np.pi, _DIRECTIONS, endpoint=False)
    angles = angles[np.argsort(np.abs(angles), kind="stable")]
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for share in _LENGTH_SHARES:
        reach = share * tail
        along = np.clip(strands @ ways.T, 0.0, reach)
        away = np.linalg.norm(strands[:, None] - along[..., None] * ways, axis=2)
        clear = np.minimum(away.min(axis=0, initial=np.inf), _MAX_CLEAR * chain.radius)
        if clear.max() >= 2.0 * chain.radius:
            break
    return np.asarray(reach * basis @ ways[clear.argmax()])
