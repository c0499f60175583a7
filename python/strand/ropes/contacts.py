"""Contacts: stretches along which strands lie near each other and do not cross."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import ceil, pi
from typing import Any

import numpy as np
import rustworkx as rx
from numpy.typing import ArrayLike, NDArray

from strand.geometry.frames import check_direction
from strand.geometry.line import Line
from strand.geometry.meeting import find_meeting_boxes
from strand.ropes.clearance import find_nearest_on_segments
from strand.ropes.crossings import Crossing, find_crossings
from strand.support.checks import Array, check_nonnegative

# strands are compared in steps of so many radii, and of not more than so many in all
_STEP, _MOST_STEPS = 0.5, 1_000_000
# a crossing reaches as far as strands come apart by so much of what straight ones of its angle do, the sine
# of the angle at least this; a circle's arc comes apart by half of that until it is parallel
_LEAVES, _FLATTEST = 1.0 / 3.0, 0.1


@dataclass(frozen=True, eq=False)
class Contact:
    """Two strands that lie near each other along a stretch and do not cross there.

    Attributes
    ----------
    first, second : (int, float)
        The chain's number and the arc length, metres, of both strands where they are nearest to each other;
        the first is the earlier one along the chains.
    point_first, point_second : (3,) ndarray
        The places of both axes, world frame, metres.
    gap : float
        Clearance between the surfaces there, metres: the distance of the axes, less both radii. Below 0 the
        tubes of the model cut into each other.
    stretch_first, stretch_second : (float, float)
        Arc lengths between which each strand is near the other, metres; of a closed chain they may be below
        0 or above its length.
    """

    first: tuple[int, float]
    second: tuple[int, float]
    point_first: Array
    point_second: Array
    gap: float
    stretch_first: tuple[float, float]
    stretch_second: tuple[float, float]

    def __str__(self) -> str:
        (one, s), (other, t) = self.first, self.second
        return (
            f"chain {one} at {s * 1e3:.0f} mm lies {self.gap * 1e3:.1f} mm from "
            f"chain {other} at {t * 1e3:.0f} mm"
        )


@dataclass(frozen=True)
class _Steps:
    """All chains in even, straight steps.

    Attributes
    ----------
    start, stop : (S, 3) ndarray
        Metres.
    arcs : (S, 2) ndarray
        Arc lengths of both, metres.
    chain : (S,) ndarray of int
    before, after : (S,) ndarray of int
        The steps before and after it; -1 at ends.
    """

    start: Array
    stop: Array
    arcs: Array
    chain: NDArray[np.intp]
    before: NDArray[np.intp]
    after: NDArray[np.intp]


def find_contacts(chains: Sequence[Line], distance: float, direction: ArrayLike) -> tuple[Contact, ...]:
    """Find where strands are near each other and do not cross, see `Model.contacts`."""
    most = check_nonnegative("distance", distance)
    towards = check_direction("direction", direction)
    if not chains:
        return ()
    steps = _steps(chains)
    pairs, places, away = _near(chains, steps, most)
    crossed = _of_crossings(chains, steps, pairs, places, away, find_crossings(chains, towards, ()), most)
    keys = pairs[:, 0] * len(steps.chain) + pairs[:, 1]
    found = []
    for group in _together(steps, pairs, keys, ~crossed):
        found.append(_contact(chains, steps, pairs[group], places[group], int(away[group].argmin())))
    return tuple(sorted(found, key=lambda contact: (contact.first, contact.second)))


def _steps(chains: Sequence[Line]) -> _Steps:
    """Cut chains in even steps."""
    least = min(chain.radius for chain in chains)
    step = max(_STEP * least, sum(chain.length for chain in chains) / _MOST_STEPS)
    parts: list[tuple[NDArray[Any], ...]] = []
    count = 0
    for i, chain in enumerate(chains):
        number = max(ceil(chain.length / step), 3 if chain.closed else 1)
        s = np.linspace(0.0, chain.length, number + 1)
        places, here = chain.at(s), count + np.arange(number)
        before, after = np.roll(here, 1), np.roll(here, -1)
        if not chain.closed:
            before[0] = after[-1] = -1
        arcs = np.stack([s[:-1], s[1:]], axis=1)
        parts.append((places[:-1], places[1:], arcs, np.full(number, i), before, after))
        count += number
    return _Steps(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _near(chains: Sequence[Line], steps: _Steps, distance: float) -> tuple[NDArray[np.intp], Array, Array]:
    """Return pairs of steps near each other, sorted: where on both, and how far apart the surfaces are."""
    radius, length, closed = (
        np.array([getattr(chain, name) for chain in chains]) for name in ("radius", "length", "closed")
    )
    low, high = np.minimum(steps.start, steps.stop), np.maximum(steps.start, steps.stop)
    reach = (radius[steps.chain] + 0.5 * distance)[:, None]
    cell = float(max(2.0 * reach.max(), (high - low).max()))
    origin = low.min(axis=0)
    found = []
    for one, other in find_meeting_boxes(low - reach - origin, high + reach - origin, cell):
        i, j = np.minimum(one, other), np.maximum(one, other)
        limit = radius[steps.chain[i]] + radius[steps.chain[j]] + distance
        # legs of a bend are strands of their own if the way round is longer than a half circle
        s = 0.5 * (steps.arcs[j].sum(axis=1) - steps.arcs[i].sum(axis=1))
        mine = steps.chain[i]
        s = np.where(closed[mine], np.minimum(s, length[mine] - s), s)
        apart = (mine != steps.chain[j]) | (s > 0.5 * pi * limit)
        i, j, limit = i[apart], j[apart], limit[apart]
        share, away = find_nearest_on_segments(steps.start[i], steps.stop[i], steps.start[j], steps.stop[j])
        near = away < limit
        at = np.stack([_along(steps.arcs[i], share[0]), _along(steps.arcs[j], share[1])], axis=1)
        surfaces = away - limit + distance
        found.append((np.stack([i, j], axis=1)[near], at[near], surfaces[near]))
    pairs, places, away = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    return pairs[order], places[order], away[order]


def _along(arcs: Array, share: Array) -> Array:
    return np.asarray(arcs[:, 0] + share * (arcs[:, 1] - arcs[:, 0]))


def _of_crossings(
    chains: Sequence[Line],
    steps: _Steps,
    pairs: NDArray[np.intp],
    places: Array,
    away: Array,
    crossings: Sequence[Crossing],
    distance: float,
) -> NDArray[np.bool_]:
    """(P,) Which pairs are near each other because the strands cross.

    That is told for each pair alone: `distance` only bounds where to look for them.
    """
    crossed = np.zeros(len(pairs), dtype=bool)
    first = np.searchsorted(steps.chain, np.arange(len(chains)))
    count = np.searchsorted(steps.chain, np.arange(len(chains)), side="right") - first
    for one in crossings:
        (i, s), (k, t) = sorted((one.over, one.under))
        sine, radii = max(np.sin(one.angle), _FLATTEST), chains[i].radius + chains[k].radius
        reach = (radii + distance) / (_LEAVES * sine)
        turns = (-1, 0, 1) if chains[i].closed else (0,)
        # past the seam of a ring the later place of its crossing with itself comes first
        orders = [(s, t), (t, s)] if i == k and chains[i].closed else [(s, t)]
        for order, turn in product(orders, turns):
            # pairs are sorted by their first step
            around = np.array([order[0] - reach, order[0] + reach]) + turn * chains[i].length
            numbers = first[i] + np.clip(around / chains[i].length * count[i], -1, count[i] + 1)
            low, high = np.searchsorted(pairs[:, 0], [np.floor(numbers[0]), np.ceil(numbers[1]) + 1])
            some = slice(low, high)
            off = np.abs(places[some] - order)
            for side, chain in ((0, chains[i]), (1, chains[k])):
                if chain.closed:
                    off[:, side] = np.minimum(off[:, side], chain.length - off[:, side])
            mine = (steps.chain[pairs[some]] == [i, k]).all(axis=1)
            # straight strands are so far apart there, and tubes that cut into each other are no contact
            straight = off.max(axis=1) * sine
            crossed[some] |= mine & (straight <= np.maximum(radii, (away[some] + radii) / _LEAVES))
    return crossed


def _together(
    steps: _Steps, pairs: NDArray[np.intp], keys: NDArray[np.intp], kept: NDArray[np.bool_]
) -> list[NDArray[np.intp]]:
    """Return stretches: pairs of steps that follow each other along both strands."""
    some = np.flatnonzero(kept)
    graph = rx.PyGraph()
    graph.add_nodes_from(range(len(pairs)))
    i, j = pairs[some].T
    for one, other in (
        (i, steps.after[j]),
        (steps.after[i], j),
        (steps.after[i], steps.after[j]),
        (steps.after[i], steps.before[j]),
    ):
        inside = (one >= 0) & (other >= 0)
        numbers = np.minimum(one, other) * len(steps.chain) + np.maximum(one, other)
        at = np.minimum(np.searchsorted(keys, numbers), len(keys) - 1)
        linked = inside & (keys[at] == numbers) & kept[at]
        graph.add_edges_from_no_data(list(zip(some[linked].tolist(), at[linked].tolist(), strict=True)))
    groups = rx.connected_components(graph)
    return [np.array(sorted(group)) for group in groups if kept[min(group)]]


def _contact(
    chains: Sequence[Line], steps: _Steps, pairs: NDArray[np.intp], places: Array, best: int
) -> Contact:
    """Make a contact of pairs of steps that are near each other, the best of them the nearest."""
    numbers = steps.chain[pairs[best]].tolist()
    points, stretches, at = [], [], places[best].tolist()
    for side, number in enumerate(numbers):
        chain, s = chains[number], places[:, side]
        if chain.closed:
            s = s - chain.length * np.rint((s - at[side]) / chain.length)
        points.append(chain.at(at[side]))
        stretches.append((float(s.min()), float(s.max())))
    gap = float(np.linalg.norm(points[0] - points[1])) - sum(chains[number].radius for number in numbers)
    return Contact(
        (numbers[0], at[0]), (numbers[1], at[1]), points[0], points[1], gap, stretches[0], stretches[1]
    )
