"""Places where chains of a harness meet at a node: strands that share one neither cross nor touch there."""

from __future__ import annotations

from collections.abc import Sequence

from strand.geometry.line import Line

Ends = Sequence[tuple[int, int]]
"""The node where each chain starts and the one where it stops; empty without a harness."""

_REACH = 4.0  # sums of two radii along both strands, within which they count as meeting at their node


def meet_at_node(
    chains: Sequence[Line], ends: Ends, first: tuple[int, float], second: tuple[int, float]
) -> bool:
    """Tell whether two places, each a chain's number and an arc length, are near a node that chains share."""
    if not ends:
        return False
    reach = _REACH * (chains[first[0]].radius + chains[second[0]].radius)
    near = [
        {
            node
            for node, away in zip(ends[number], (s, chains[number].length - s), strict=True)
            if away < reach
        }
        for number, s in (first, second)
    ]
    return bool(near[0] & near[1])
