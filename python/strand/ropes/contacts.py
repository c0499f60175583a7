"""Contacts: stretches along which strands lie near each other without crossing."""

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
from strand.ropes.joints import Ends, meet_at_node
from strand.support.checks import Array, check_nonnegative

_STEP = 0.5  # radii: length of the steps in which strands are compared
_MAX_STEPS = 1_000_000  # of all chains; longer steps beyond
# a circle's arc separates half as fast as straight strands until it is parallel
_MIN_SEPARATION = 1.0 / 3.0  # of that of straight strands; with less a stretch is no part of a crossing
_MIN_SINE = 0.1  # of the angle of a crossing


@dataclass(frozen=True, eq=False)
class Contact:
    """Two strands that lie near each other along a stretch without crossing there.

    Attributes
    ----------
    first, second : (int, float)
        Chain number and arc length, metres, of the nearest place on both strands, in order along the chains.
    point_first, point_second : (3,) ndarray
        These places on the axes, world frame, metres.
    gap : float
        Clearance between the surfaces there, metres. Negative if the tubes of the model intersect.
    stretch_first, stretch_second : (float, float)
        Arc lengths between which each strand is near the other, metres. On a closed chain they may be
        negative or above its length.
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
    """All chains in S even, straight steps: ends (S, 3), arc lengths of both ends (S, 2), chain numbers (S,).

    `before` and `after` (S,) are the numbers of the neighbouring steps, -1 at open ends.
    """

    start: Array
    stop: Array
    arcs: Array
    chain: NDArray[np.intp]
    before: NDArray[np.intp]
    after: NDArray[np.intp]


def find_contacts(
    chains: Sequence[Line], distance: float, direction: ArrayLike, ends: Ends = ()
) -> tuple[Contact, ...]:
    """Find where strands are near each other without crossing, see `Model.contacts`."""
    most = check_nonnegative("distance", distance)
    towards = check_direction("direction", direction)
    if not chains:
        return ()
    steps = _cut_steps(chains)
    pairs, places, away = _find_near_pairs(chains, steps, most)
    crossed = _mark_crossings(chains, steps, pairs, places, away, find_crossings(chains, towards, ()), most)
    keys = pairs[:, 0] * len(steps.chain) + pairs[:, 1]
    found = []
    for group in _group_pairs(steps, pairs, keys, ~crossed):
        contact = _make_contact(chains, steps, pairs[group], places[group], int(away[group].argmin()))
        # where chains share a node, a contact goes on from there
        sides = (contact.first[0], contact.stretch_first), (contact.second[0], contact.stretch_second)
        corners = product(*([(number, s) for s in stretch] for number, stretch in sides))
        if not any(meet_at_node(chains, ends, *corner) for corner in corners):
            found.append(contact)
    return tuple(sorted(found, key=lambda contact: (contact.first, contact.second)))


def _cut_steps(chains: Sequence[Line]) -> _Steps:
    """Cut chains into even steps."""
    least = min(chain.radius for chain in chains)
    step = max(_STEP * least, sum(chain.length for chain in chains) / _MAX_STEPS)
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


def _find_near_pairs(
    chains: Sequence[Line], steps: _Steps, distance: float
) -> tuple[NDArray[np.intp], Array, Array]:
    """Return sorted pairs of near steps, arc lengths of the nearest places, and distances of the surfaces."""
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
        # legs of a bend are separate strands if the way around is longer than a half circle
        s = 0.5 * (steps.arcs[j].sum(axis=1) - steps.arcs[i].sum(axis=1))
        mine = steps.chain[i]
        s = np.where(closed[mine], np.minimum(s, length[mine] - s), s)
        apart = (mine != steps.chain[j]) | (s > 0.5 * pi * limit)
        i, j, limit = i[apart], j[apart], limit[apart]
        share, away = find_nearest_on_segments(steps.start[i], steps.stop[i], steps.start[j], steps.stop[j])
        near = away < limit
        at = np.stack(
            [_interpolate_arcs(steps.arcs[i], share[0]), _interpolate_arcs(steps.arcs[j], share[1])], axis=1
        )
        surfaces = away - limit + distance
        found.append((np.stack([i, j], axis=1)[near], at[near], surfaces[near]))
    pairs, places, away = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    return pairs[order], places[order], away[order]


def _interpolate_arcs(arcs: Array, share: Array) -> Array:
    return np.asarray(arcs[:, 0] + share * (arcs[:, 1] - arcs[:, 0]))


def _mark_crossings(
    chains: Sequence[Line],
    steps: _Steps,
    pairs: NDArray[np.intp],
    places: Array,
    away: Array,
    crossings: Sequence[Crossing],
    distance: float,
) -> NDArray[np.bool_]:
    """Return (P,) whether a pair is near only because its strands cross.

    `distance` bounds the search; each pair is decided by itself.
    """
    crossed = np.zeros(len(pairs), dtype=bool)
    first = np.searchsorted(steps.chain, np.arange(len(chains)))
    count = np.searchsorted(steps.chain, np.arange(len(chains)), side="right") - first
    for one in crossings:
        (i, s), (k, t) = sorted((one.over, one.under))
        sine, radii = max(np.sin(one.angle), _MIN_SINE), chains[i].radius + chains[k].radius
        reach = (radii + distance) / (_MIN_SEPARATION * sine)
        turns = (-1, 0, 1) if chains[i].closed else (0,)
        # beyond the seam of a ring the later place of a crossing with itself comes first
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
            # compare with straight strands; intersecting tubes are no contact
            straight = off.max(axis=1) * sine
            crossed[some] |= mine & (straight <= np.maximum(radii, (away[some] + radii) / _MIN_SEPARATION))
    return crossed


def _group_pairs(
    steps: _Steps, pairs: NDArray[np.intp], keys: NDArray[np.intp], kept: NDArray[np.bool_]
) -> list[NDArray[np.intp]]:
    """Return groups of pairs that follow each other along both strands."""
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


def _make_contact(
    chains: Sequence[Line], steps: _Steps, pairs: NDArray[np.intp], places: Array, best: int
) -> Contact:
    """Make a contact of a group of pairs, of which `best` is the nearest."""
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
