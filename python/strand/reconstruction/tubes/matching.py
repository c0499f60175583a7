"""Which ends are joined: matchings of least cost, without geometry."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from heapq import heappop, heappush

import numpy as np
import rustworkx as rx

from strand.geometry.polyline import order_segments
from strand.reconstruction.tubes.clouds import Pair
from strand.reconstruction.tubes.join_costs import JoinCosts

# weights of the matching are whole numbers, in millionths of the cost
_UNIT = 1e6
# so many ways to bridge gaps are compared at a time and in all, and so many to do without rings; each of
# these takes a matching, so fewer where there is much to match
_WAYS, _ALL_WAYS, _RINGLESS, _MATCHED = 20000, 60000, 500, 100_000
# of more joins than this the cheapest each are taken
_MANY = 300

Priced = Sequence[tuple[float, int, int]]


def matched(costs: JoinCosts, free_end: float, without: Collection[Pair] = ()) -> tuple[list[Pair], float]:
    """Join ends by the matching of least cost.

    Parameters
    ----------
    costs : JoinCosts
    free_end : float
        Cost of an end that is joined to none.
    without : collection of (int, int)
        Pairs that may not be joined.

    Returns
    -------
    joins : list of (int, int)
    cost : float
        Of all joins and free ends.
    """
    joins, cost = _matched(costs, free_end, without)
    if costs.rings:
        return joins, cost
    # without rings: matchings that close one are parted by the first of its joins that they lack
    ways = [(cost, 0, joins, frozenset(without))]
    most = min(_RINGLESS, _MATCHED // max(len(costs.costs), 1))
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
            joins, cost = _matched(costs, free_end, fewer)
            heappush(ways, (cost, count, joins, fewer))
            barred |= {other for other in costs.costs if other != pair and not set(pair).isdisjoint(other)}


def _matched(costs: JoinCosts, free_end: float, without: Collection[Pair]) -> tuple[list[Pair], float]:
    """Join ends by the matching of least cost, rings or not."""
    graph = rx.PyGraph()
    graph.add_nodes_from(range(2 * len(costs.arcs)))
    for pair, cost in costs.costs.items():
        if cost < 2.0 * free_end and pair not in without:
            graph.add_edge(*pair, round((2.0 * free_end - cost) * _UNIT))
    joins = sorted((min(pair), max(pair)) for pair in rx.max_weight_matching(graph, weight_fn=int))
    free = 2 * (len(costs.arcs) - len(joins))
    return joins, sum(costs.costs[pair] for pair in joins) + free * free_end


def free_ends(joins: Sequence[Pair], chain_of: Sequence[int]) -> list[int]:
    """Return the ends that are not joined, of arcs whose chain has a number, not -1."""
    taken = {end for pair in joins for end in pair}
    return [end for end in range(2 * len(chain_of)) if end not in taken and chain_of[end // 2] >= 0]


def joined_to(ropes: int, priced: Priced, chain_of: Sequence[int]) -> list[Pair]:
    """Join chains until so many are left.

    Parameters
    ----------
    ropes : int
        How many chains to leave.
    priced : sequence of (float, int, int)
        Cost of a join and its two ends, the cheapest first.
    chain_of : sequence of int
        For each arc the number of its chain; -1 for those that are left out.

    Returns
    -------
    list of (int, int)
        The joins that cost least together, none of which closes a ring. There may be too few.
    """
    wanted = len({number for number in chain_of if number >= 0}) - ropes
    first = _greedy(priced, chain_of, wanted)
    if len(first) > _MANY:
        return [(min(pair), max(pair)) for pair in first]
    tried = 0
    while wanted > 0:
        if tried > _ALL_WAYS:
            return [(min(pair), max(pair)) for pair in first[:wanted]]
        more, ways = _cheapest(priced, chain_of, wanted, first if len(first) == wanted else [])
        if more:
            return more
        tried, all_tried = tried + ways, ways <= _WAYS
        # how many there can be is not known if not all were tried, but so many there are
        wanted = wanted - 1 if all_tried else min(wanted - 1, len(first))
    return []


def joined_most(priced: Priced, arcs: int) -> list[Pair]:
    """Return as many joins as there can be, of those the ones that cost least together; rings may close."""
    graph = rx.PyGraph()
    graph.add_nodes_from(range(2 * arcs))
    most = max((cost for cost, _, _ in priced), default=0.0)
    graph.add_edges_from([(i, j, round((most - cost) * _UNIT)) for cost, i, j in priced])
    more = rx.max_weight_matching(graph, max_cardinality=True, weight_fn=int)
    return sorted((min(pair), max(pair)) for pair in more)


def _greedy(priced: Priced, chain_of: Sequence[int], wanted: int) -> list[Pair]:
    """Return pairs that always join two chains, each the cheapest that is left, at most `wanted`."""
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


def _cheapest(
    priced: Priced, chain_of: Sequence[int], wanted: int, known: Sequence[Pair]
) -> tuple[list[Pair], int]:
    """Return the `wanted` pairs that cost least together and always join two chains, and how many were tried.

    Parameters
    ----------
    priced : sequence of (float, int, int)
        The cheapest first.
    chain_of : sequence of int
    wanted : int
    known : sequence of (int, int)
        So many pairs, if they are known.
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
            # what is to come is not cheaper
            if cost + left * more >= best[0] or ways > _WAYS:
                return
            a, b = group[chain_of[i // 2]], group[chain_of[j // 2]]
            if a == b or any(end in pair for pair in chosen for end in (i, j)):
                continue
            merged = {chain: a if number == b else number for chain, number in group.items()}
            search(k + 1, [*chosen, (i, j)], cost + more, merged)

    search(0, [], 0.0, {number: number for number in chain_of})
    return [(min(pair), max(pair)) for pair in best[1]], ways
