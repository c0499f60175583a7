"""Which way ropes come apart: an end is moved back over a crossing, or a loop is lifted off, one by one."""

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
from strand.support.checks import Array

# how far a rope goes beyond a crossing that it leaves, in both radii; how many ways an end may lie then, and
# shares of its length
_BEYOND = 2.0
_FLATTEST = 0.25  # the least sine of the angle at a crossing that counts
_WAYS = 36
_SHARES = (1.0, 0.75, 0.5, 0.25)
# how many times a way counts on which an end that is pulled out drags its rope, and on which a strand that is
# lifted over an end draws rope from both sides; and the length of a tail that is not laid straight, which may
# stay at the crossing
_DRAGGED, _DRAWN, _SLACK = 2.0, 3.0, 8.0


@dataclass(frozen=True, eq=False)
class Pull:
    """One move that undoes crossings.

    Attributes
    ----------
    undoes : tuple of Crossing
        One, or two of a loop.
    move : str
        "end": an end goes back over the crossing, or is pulled out beneath it. "loop": a stretch that lies on
        another one is lifted off it, to the side or over the other one's end.
    lift : bool
        Whether what is moved is lifted over the other strand. If not it lies beneath, and is pulled out along
        the table.
    chain : int
        The number of the chain that is moved.
    s : float
        Arc length of the place to hold, metres: an end, the middle of a loop or where it crosses an end, or,
        where an end is pulled out, a place just beyond the crossing.
    place : (3,) ndarray
        This place, world frame, metres.
    direction : (3,) ndarray
        Unit vector across the direction of view: the way that the place is moved.
    distance : float
        How far, metres.
    slack : float
        Length of an end that there is no room to lay out straight, metres: it may stay at the crossing, and
        then another pull is needed.
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
        In order. Each but the first is told for ropes as they lie now: look again after each.
    left : tuple of Crossing
        What they do not undo: crossings of rings with each other or themselves.
    """

    pulls: tuple[Pull, ...]
    left: tuple[Crossing, ...]


class _Pass(NamedTuple):
    """A strand at a crossing: the chain, the arc length, the crossing's number, whether it is on top."""

    chain: int
    s: float
    crossing: int
    over: bool


class _Way(NamedTuple):
    """A pull, and what it costs: metres of way."""

    pull: Pull
    effort: float


def plan_pulls(chains: Sequence[Line], crossings: Sequence[Crossing], direction: ArrayLike) -> PullPlan:
    """Plan how ropes come apart, see `Model.pull_plan`."""
    towards = check_direction("direction", direction)
    left = dict(enumerate(crossings))
    pulls = []
    while left:
        passes = _passes(chains, left)
        ways = [*_loops(chains, left, passes, towards), *_ends(chains, left, passes, towards)]
        if not ways:
            break
        # the least effort for each crossing that it undoes
        best = min(ways, key=lambda way: way.effort / len(way.pull.undoes)).pull
        pulls.append(best)
        left = {k: one for k, one in left.items() if not any(one is gone for gone in best.undoes)}
    return PullPlan(tuple(pulls), tuple(left.values()))


def _passes(chains: Sequence[Line], crossings: dict[int, Crossing]) -> list[list[_Pass]]:
    """Return the passes of each chain in order."""
    passes: list[list[_Pass]] = [[] for _ in chains]
    for k, one in crossings.items():
        for (chain, s), over in ((one.over, True), (one.under, False)):
            passes[chain].append(_Pass(chain, s, k, over))
    return [sorted(row, key=lambda each: each.s) for row in passes]


def _beyond(chains: Sequence[Line], crossing: Crossing) -> float:
    """Return how far a rope goes beyond a crossing that it leaves, metres."""
    return _BEYOND * (chains[crossing.over[0]].radius + chains[crossing.under[0]].radius)


def _loops(
    chains: Sequence[Line], crossings: dict[int, Crossing], passes: list[list[_Pass]], towards: Array
) -> list[_Way]:
    """Return moves of stretches that lie on another one, with nothing between (Reidemeister's second)."""
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
            way = _across(chains, lower, both, (a.chain, a.s, length), towards)
            # from the place that is held to beyond all of the lower stretch
            passed = max(float(((_stretch(chains, *lower) - place) @ way).max()), 0.0)
            distance = passed + _beyond(chains, both[0])
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


def _stretch(chains: Sequence[Line], which: int, start: float, length: float) -> Array:
    """(N, 3) Places along a stretch of a chain."""
    chain = chains[which]
    s = start + np.linspace(0.0, length, 50)
    return np.asarray(chain.at(s % chain.length if chain.closed else s))


def _across(
    chains: Sequence[Line],
    lower: tuple[int, float, float],
    both: tuple[Crossing, Crossing],
    upper: tuple[int, float, float],
    towards: Array,
) -> Array:
    """(3,) Unit vector in the plan, from the upper of two stretches that cross twice to the lower one."""
    chord = both[1].place - both[0].place
    across = np.cross(towards, chord)
    apart = _stretch(chains, *lower).mean(axis=0) - _stretch(chains, *upper).mean(axis=0)
    apart -= (apart @ towards) * towards
    length = float(np.linalg.norm(across))
    if length < min(chains[lower[0]].radius, chains[upper[0]].radius):
        # crossings at one place: between the stretches' middles
        across, length = apart, float(np.linalg.norm(apart))
    if length < 1e-9:
        # one stretch right above the other: either way
        tangent = chains[upper[0]].tangent_at(upper[1])
        across = np.cross(towards, tangent if abs(tangent @ towards) < 0.999 else tangent[[1, 2, 0]])
        length = float(np.linalg.norm(across))
    return np.asarray(across / length * (1.0 if across @ apart >= 0.0 else -1.0))


def _ends(
    chains: Sequence[Line], crossings: dict[int, Crossing], passes: list[list[_Pass]], towards: Array
) -> list[_Way]:
    """Return moves that undo the crossings next to ends: of an end, or of a strand lifted over it."""
    found = []
    for i, (row, chain) in enumerate(zip(passes, chains, strict=True)):
        if chain.closed or not row:
            continue
        for first, end, inwards in ((row[0], 0.0, 1.0), (row[-1], chain.length, -1.0)):
            one = crossings[first.crossing]
            beyond = _beyond(chains, one)
            if not first.over:
                # it is held there, clear of the other strand also where they cross at a flat angle
                beyond /= max(np.sin(one.angle), _FLATTEST)
            turn = float(np.clip(first.s + inwards * beyond, 0.0, chain.length))
            tail = abs(first.s - end) + beyond
            way = _free_way(chains, i, turn, end, tail, inwards, towards)
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
                off = _off_end(chains, one, i, end, tail, towards)
                found += [] if off is None else [off]
            found.append(_Way(pull, distance * (1.0 if pull.lift else _DRAGGED) + _SLACK * slack))
    return found


def _off_end(
    chains: Sequence[Line], crossing: Crossing, which: int, end: float, tail: float, towards: Array
) -> _Way | None:
    """Return how the upper strand is lifted over the lower one's end; None where others are in the way."""
    upper, s = crossing.over
    place, last = chains[upper].at(s), chains[which].at(end)
    way = last - place
    way -= (way @ towards) * towards
    length = float(np.linalg.norm(way))
    beyond = _beyond(chains, crossing)
    if length < 1e-9:
        return None
    way /= length
    distance = length + beyond
    others = _strands(chains, [(which, end, tail), (upper, s, 2.0 * beyond)]) - place
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
    return _Way(pull, _DRAWN * distance)


def _strands(chains: Sequence[Line], left_out: Sequence[tuple[int, float, float]]) -> Array:
    """(N, 3) Places on all chains, a radius apart, but those within a length of a chain's place."""
    found = []
    for i, each in enumerate(chains):
        s = np.arange(0.0, each.length, each.radius)
        for which, at, reach in left_out:
            if which == i:
                s = s[np.abs(s - at) > reach + 4.0 * each.radius]
        found.append(each.at(s).reshape(-1, 3))
    return np.concatenate(found)


def _free_way(
    chains: Sequence[Line],
    which: int,
    turn: float,
    end: float,
    tail: float,
    inwards: float,
    towards: Array,
) -> Array:
    """(3,) From `turn` to where a straight tail would end that lies clear of all strands in the plan, metres.

    The tail is shorter than it is if there is no room for all of it.
    """
    chain = chains[which]
    back = inwards * chain.tangent_at(turn)
    back -= (back @ towards) * towards
    length = float(np.linalg.norm(back))
    # a rope that runs along the direction of view leads nowhere in the plan
    back = back / length if length > 1e-9 else np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    back /= np.linalg.norm(back)
    aside = np.cross(towards, back)
    basis = np.stack([back, aside], axis=1)
    # the tail goes along, and so does what is next to it
    strands = (_strands(chains, [(which, end, abs(end - turn))]) - chain.at(turn)) @ basis
    # from what is straight back outwards: the first of equals is kept
    angles = np.linspace(-np.pi, np.pi, _WAYS, endpoint=False)
    angles = angles[np.argsort(np.abs(angles), kind="stable")]
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    for share in _SHARES:
        reach = share * tail
        along = np.clip(strands @ ways.T, 0.0, reach)
        away = np.linalg.norm(strands[:, None] - along[..., None] * ways, axis=2)
        clear = np.minimum(away.min(axis=0, initial=np.inf), 3.0 * chain.radius)
        if clear.max() >= 2.0 * chain.radius:
            break
    return np.asarray(reach * basis @ ways[clear.argmax()])
