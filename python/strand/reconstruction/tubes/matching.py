"""Match the ends of arcs at least cost, without geometry."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from heapq import heappop, heappush

import numpy as np
import rustworkx as rx

from strand.geometry.polyline import order_segments
from strand.reconstruction.tubes.clouds import Pair
from strand.reconstruction.tubes.join_costs import JoinCosts

_UNIT = 1e6  # whole numbers per unit of cost, as the matching takes whole weights
_MAX_WAYS = 20_000  # pairs that one search for the cheapest joins tries
_MAX_ALL_WAYS = 60_000  # pairs that all these searches try
_MAX_OPENINGS = 500  # matchings that are tried to open rings
_MAX_MATCHED = 100_000  # pairs of ends in all these matchings together
_MAX_EXACT = 300  # joins: more are taken one by one, the cheapest first

Priced = Sequence[tuple[float, int, int]]
"""Cost of each join and its two ends, the cheapest first."""


def match_ends(costs: JoinCosts, free_end: float, without: Collection[Pair] = ()) -> tuple[list[Pair], float]:
    """Return the joins of least cost, and that cost, to which each free end adds.

    Pairs in `without` are not joined.
    """
    joins, cost = _match_once(costs, free_end, without)
    if costs.rings:
        return joins, cost
    # where rings are not allowed, each join of a ring is barred in turn
    ways = [(cost, 0, joins, frozenset(without))]
    most = min(_MAX_OPENINGS, _MAX_MATCHED // max(len(costs.costs), 1))
    count = 0
    while True:
        cost, _, joins, barred = heappop(ways)
        rings = [entered for entered, closed in order_segments(len(costs.arcs), joins) if closed]
        if not rings:
            return joins, cost
        arcs = {end // 2 for end in rings[0]}
        ring = [pair for pair in joins if pair[0] // 2 in arcs]
        ring.sort(key=costs.costs.__getitem__, reverse=True)
        if count > most:
            ways, ring = [], ring[:1]
        for pair in ring:
            count += 1
            fewer = barred | {pair}
            joins, cost = _match_once(costs, free_end, fewer)
            heappush(ways, (cost, count, joins, fewer))
            barred |= {other for other in costs.costs if other != pair and not set(pair).isdisjoint(other)}


def _match_once(costs: JoinCosts, free_end: float, without: Collection[Pair]) -> tuple[list[Pair], float]:
    """Return the joins of least cost, which may close rings, with that cost."""
    graph = rx.PyGraph()
    graph.add_nodes_from(range(2 * len(costs.arcs)))
    for pair, cost in costs.costs.items():
        if cost < 2.0 * free_end and pair not in without:
            graph.add_edge(*pair, round((2.0 * free_end - cost) * _UNIT))
    joins = sorted((min(pair), max(pair)) for pair in rx.max_weight_matching(graph, weight_fn=int))
    free = 2 * (len(costs.arcs) - len(joins))
    return joins, sum(costs.costs[pair] for pair in joins) + free * free_end


def list_free_ends(joins: Sequence[Pair], chain_of: Sequence[int]) -> list[int]:
    """Return the ends that are not joined, of arcs whose chain's number is not -1."""
    taken = {end for pair in joins for end in pair}
    return [end for end in range(2 * len(chain_of)) if end not in taken and chain_of[end // 2] >= 0]


def join_until(ropes: int, priced: Priced, chain_of: Sequence[int]) -> list[Pair]:
    """Return the joins of least cost that leave a number of ropes and close no ring; there may be too few.

    `chain_of` has the number of each arc's chain, -1 for arcs that do not count.
    """
    wanted = len({number for number in chain_of if number >= 0}) - ropes
    first = _join_greedily(priced, chain_of, wanted)
    if len(first) > _MAX_EXACT:
        return [(min(pair), max(pair)) for pair in first]
    tried = 0
    while wanted > 0:
        if tried > _MAX_ALL_WAYS:
            return [(min(pair), max(pair)) for pair in first[:wanted]]
        more, ways = _join_cheapest(priced, chain_of, wanted, first if len(first) == wanted else [])
        if more:
            return more
        tried, all_tried = tried + ways, ways <= _MAX_WAYS
        # if not all ways were tried, `first` says how many joins there can be at least
        wanted = wanted - 1 if all_tried else min(wanted - 1, len(first))
    return []


def join_most(priced: Priced, arcs: int) -> list[Pair]:
    """Return the joins of least cost among those that join most ends; they may close rings."""
    graph = rx.PyGraph()
    graph.add_nodes_from(range(2 * arcs))
    most = max((cost for cost, _, _ in priced), default=0.0)
    graph.add_edges_from([(i, j, round((most - cost) * _UNIT)) for cost, i, j in priced])
    more = rx.max_weight_matching(graph, max_cardinality=True, weight_fn=int)
    return sorted((min(pair), max(pair)) for pair in more)


def _join_greedily(priced: Priced, chain_of: Sequence[int], wanted: int) -> list[Pair]:
    """Return up to `wanted` pairs that each join two chains, always the cheapest that is left."""
    group = {number: number for number in chain_of}
    chosen: list[Pair] = []
    taken: set[int] = set()
    for _, i, j in priced:
        if len(chosen) >= wanted:
            break
        a, b = group[chain_of[i // 2]], group[chain_of[j // 2]]
        if a != b and i not in taken and j not in taken:
            chosen.append((i, j))
            taken |= {i, j}
            group = {chain: a if number == b else number for chain, number in group.items()}
    return chosen


def _join_cheapest(
    priced: Priced, chain_of: Sequence[int], wanted: int, known: Sequence[Pair]
) -> tuple[list[Pair], int]:
    """Return the `wanted` pairs of least cost that each join two chains, and the number of pairs tried.

    `known` is a first solution of `wanted` pairs, or empty.
    """
    price = {(i, j): cost for cost, i, j in priced}
    best: tuple[float, list[Pair]] = (np.inf, [])
    if known:
        best = sum(price[pair] for pair in known), list(known)
    ways = 0

    def search(first: int, chosen: list[Pair], cost: float, group: dict[int, int]) -> None:
        nonlocal best, ways
        left = wanted - len(chosen)
        if left <= 0:
            best = min(best, (cost, list(chosen)), key=lambda way: way[0])
            return
        for k in range(first, len(priced) - left + 1):
            more, i, j = priced[k]
            ways += 1
            # the pairs that follow are not cheaper
            if cost + left * more >= best[0] or ways > _MAX_WAYS:
                return
            a, b = group[chain_of[i // 2]], group[chain_of[j // 2]]
            if a == b or any(end in pair for pair in chosen for end in (i, j)):
                continue
            merged = {chain: a if number == b else number for chain, number in group.items()}
            search(k + 1, [*chosen, (i, j)], cost + more, merged)

    search(0, [], 0.0, {number: number for number in chain_of})
    return [(min(pair), max(pair)) for pair in best[1]], ways
