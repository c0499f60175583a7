"""Matchings of least cost."""

from __future__ import annotations

import time
from itertools import combinations

import numpy as np
import pytest

from strand.geometry.polyline import order_segments
from strand.reconstruction.tubes.join_costs import JoinCosts
from strand.reconstruction.tubes.matching import join_until, match_ends


def test_the_cheapest_joins_are_those_of_an_exhaustive_search():
    rng = np.random.default_rng(0)
    for _ in range(20):
        priced = sorted(
            (float(rng.uniform(0, 10)), i, j) for i, j in combinations(range(8), 2) if i // 2 != j // 2
        )
        found = join_until(1, priced, [0, 1, 2, 3])
        cost = {(i, j): c for c, i, j in priced}
        best = np.inf
        for chosen in combinations(cost, 3):
            ends = [end for pair in chosen for end in pair]
            if len(set(ends)) == 6:
                group = list(range(4))
                rings = False
                for i, j in chosen:
                    a, b = group[i // 2], group[j // 2]
                    rings |= a == b
                    group = [a if g == b else g for g in group]
                if not rings:
                    best = min(best, sum(cost[pair] for pair in chosen))
        assert len(found) == 3
        assert sum(cost[pair] for pair in found) == pytest.approx(best)


def make_costs(costs, count, rings):
    arcs = tuple(np.zeros((2, 3)) for _ in range(count))
    return JoinCosts(arcs, costs, rings)


def test_most_chains_are_joined_without_trying_all_ways():
    # two bunches of chains with nothing that joins one to the other
    rng = np.random.default_rng(1)
    bunches = [range(0, 28), range(28, 56)]
    pairs = [(i, j) for ends in bunches for i in ends for j in ends if i // 2 < j // 2]
    priced = sorted((float(rng.uniform(0, 50)), i, j) for i, j in pairs)
    found = join_until(1, priced, list(range(28)))
    assert len(found) == 26
    assert len({end for pair in found for end in pair}) == 52
    assert set(found) <= set(pairs)
    group = list(range(28))
    for i, j in found:
        a, b = group[i // 2], group[j // 2]
        assert a != b
        group = [a if g == b else g for g in group]


def test_a_matching_without_rings_is_the_cheapest_of_those():
    rng = np.random.default_rng(0)
    closing = 0
    for _ in range(30):
        pairs = [(i, j) for i, j in combinations(range(8), 2) if i // 2 != j // 2]
        costs = {pair: float(rng.uniform(0.0, 9.0)) for pair in pairs}

        def search(k, chosen, costs=costs, pairs=pairs):
            if k == len(pairs):
                closed = any(ring for _, ring in order_segments(4, chosen))
                cost = sum(costs[pair] for pair in chosen) + 5.0 * (8 - 2 * len(chosen))
                return np.inf if closed else cost
            best = search(k + 1, chosen)
            if not any(end in pair for pair in chosen for end in pairs[k]):
                best = min(best, search(k + 1, [*chosen, pairs[k]]))
            return best

        joins, cost = match_ends(make_costs(costs, 4, rings=False), 5.0)
        assert not any(ring for _, ring in order_segments(4, joins))
        assert cost == pytest.approx(sum(costs[pair] for pair in joins) + 5.0 * (8 - 2 * len(joins)))
        assert cost == pytest.approx(search(0, []))
        closing += match_ends(make_costs(costs, 4, rings=True), 5.0)[1] < cost - 1e-9
    assert closing > 5


def test_many_rings_are_opened():
    costs = {}
    for k in range(60):
        costs[4 * k, 4 * k + 2] = costs[4 * k + 1, 4 * k + 3] = 1.0
    joins, cost = match_ends(make_costs(costs, 120, rings=False), 5.0)
    assert len(joins) == 60
    assert cost == pytest.approx(60 * 11.0)


def test_the_search_ends_where_too_few_chains_can_be_joined():
    # each chain can be joined only with its neighbour, so that half of the wanted joins exist
    rng = np.random.default_rng(2)
    priced = sorted(
        (float(rng.uniform(0, 50)), 4 * k + i, 4 * k + 2 + j)
        for k in range(40)
        for i in (0, 1)
        for j in (0, 1)
    )
    start = time.process_time()
    found = join_until(1, priced, list(range(80)))
    assert len(found) == 40
    assert time.process_time() - start < 3.0
