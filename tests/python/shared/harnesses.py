"""Harnesses of straight chains, whose graphs are given or random."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

import strand
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode


def make_harness(pairs: Sequence[tuple[int, int]], seed: int = 0, radius: float = 0.004) -> Harness:
    """Return a harness whose edges join pairs of nodes at random places; loops and twins have a corner."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.3, 0.3, (max(map(max, pairs)) + 1, 3))
    degrees = Counter(end for pair in pairs for end in pair)
    edges = []
    for number, (start, stop) in enumerate(pairs):
        corners = 0.5 * (places[start] + places[stop]) + rng.uniform(-0.1, 0.1, (2, 3))
        nodes = np.vstack([places[start], corners, places[stop]])
        edges.append(HarnessEdge(number, start, stop, strand.Chain(nodes, radius)))
    nodes = [HarnessNode(number, place, None, degrees[number]) for number, place in enumerate(places)]
    return Harness(nodes, edges)


def draw_harness(rng: np.random.Generator) -> Harness:
    """Return a random harness that may have cycles, loops, edges side by side and several parts."""
    count = int(rng.integers(2, 9))
    pairs = [tuple(rng.integers(0, count, 2).tolist()) for _ in range(int(rng.integers(1, 14)))]
    used = sorted({end for pair in pairs for end in pair})
    return make_harness([(used.index(a), used.index(b)) for a, b in pairs], int(rng.integers(1000)))


def make_rope_graph(chain: strand.Chain) -> Harness:
    """Return the graph of one rope."""
    ends = [HarnessNode(number, chain.points[-number], None, 1) for number in (0, 1)]
    return Harness(ends, [HarnessEdge(0, 0, 1, chain)])
