"""Places where chains of a harness meet at a node: strands that share one neither cross nor touch there."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

from strand.geometry.line import Line

Ends = Sequence[tuple[int, int]]
"""The node where each chain starts and the one where it stops; empty without a harness."""

_REACH = 4.0  # sums of two radii along both strands, within which they count as meeting at their node


def meet_at_node(
    chains: Sequence[Line], ends: Ends, first: tuple[int, float], second: tuple[int, float]
) -> bool:
    """Tell whether two places, each a chain's number and an arc length, are near one node of the harness.

    The way to the node may lead over edges that are shorter than the reach.
    """
    if not ends:
        return False
    reach = _REACH * (chains[first[0]].radius + chains[second[0]].radius)
    near = _find_near_nodes(chains, ends, first, reach)
    return bool(near) and not near.isdisjoint(_find_near_nodes(chains, ends, second, reach))


def _find_near_nodes(chains: Sequence[Line], ends: Ends, place: tuple[int, float], reach: float) -> set[int]:
    """Return the nodes to which the way along the edges is shorter than a reach."""
    number, s = place
    ways = list(zip(ends[number], (s, chains[number].length - s), strict=True))
    shortest: dict[int, float] = {}
    while ways:
        node, away = ways.pop()
        if away >= min(reach, shortest.get(node, math.inf)):
            continue
        shortest[node] = away
        for chain, pair in zip(chains, ends, strict=True):
            if node in pair and chain.length < reach:
                ways.append((pair[0] if node == pair[1] else pair[1], away + chain.length))
    return set(shortest)


def is_joined(ends: Ends, chain: int, side: int) -> bool:
    """Tell whether the start (side 0) or the stop (1) of a chain is at a node where others end too."""
    return bool(ends) and Counter(node for pair in ends for node in pair)[ends[chain][side]] > 1
