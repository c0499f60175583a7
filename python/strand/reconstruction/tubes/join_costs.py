"""What it costs to join the ends of arcs, by the curves that would join them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand.geometry.polyline import bridge, end_direction, find_runs, path_length
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.tubes.bridges import bridge_cost, least_bending, seen_through
from strand.reconstruction.tubes.clouds import Pair
from strand.support.checks import Array

# gaps shorter than this are looked at from a radius back too, in radii
_NEAR = 2.5
# gaps that no camera could see into may be longer by this factor; the share that must be occluded for that
_UNSEEN, _MOSTLY = 1.7, 0.8
# no gap is bridged that was seen through on such a stretch, in radii and as a share of the gap
_THROUGH = 1.0, 0.3


@dataclass(frozen=True, eq=False)
class JoinCosts:
    """What joining each pair of ends would cost: end 2k is the first node of arc k, 2k + 1 its last.

    Attributes
    ----------
    arcs : tuple of (M, 3) ndarray
        Ordered nodes, metres.
    costs : dict of (int, int) to float
        Of the pairs that are cheaper to join than to leave.
    rings : bool
        Whether joins may close rings.
    contrast : (E, E) ndarray or None
        What of each pair's cost is for the difference of their colours, if those are known.
    """

    arcs: tuple[Array, ...]
    costs: dict[Pair, float]
    rings: bool = True
    contrast: Array | None = None

    def end(self, number: int) -> Array:
        """(3,) Where an end lies, metres."""
        return np.asarray(self.arcs[number // 2][-1 if number % 2 else 0])


def outward(arcs: Sequence[Array], end: int) -> Array:
    """Nodes of an arc in the order in which they lead to one of its ends."""
    return arcs[end // 2][:: 1 if end % 2 else -1]


def join_costs(arcs: Sequence[Array], evidence: JoinEvidence) -> JoinCosts:
    """Price all joins over gaps of usual length by the curves that would make them.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    evidence : JoinEvidence

    Returns
    -------
    JoinCosts
        The kernel's `join_cost`, what cameras saw through of the gap, and the difference of colours.
    """
    radius, config, visibility = evidence.radius, evidence.config, evidence.visibility
    span = 1.5 * radius
    ends = [(nodes[-1], end_direction(nodes, 0.0, span)) for arc in arcs for nodes in (arc[::-1], arc)]
    back = [_farther_back(nodes, radius, span) for arc in arcs for nodes in (arc[::-1], arc)]
    position = np.array([p for p, _ in ends]).reshape(-1, 3)
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    # where nothing could have been seen, gaps may be longer
    farthest = config.gap * radius * (1.0 if visibility is None else _UNSEEN)
    contrast = None if evidence.colors is None else evidence.colors.join_costs(arcs, radius)
    costs: dict[tuple[int, int], float] = {}
    for i, j in zip(*np.nonzero(np.triu(distance <= farthest, k=1)), strict=True):
        i, j = int(i), int(j)
        ring = i ^ 1 == j
        if ring and (config.rings == "never" or path_length(arcs[i // 2])[-1] < config.loop * radius):
            continue
        (p, leave), (q, arrive) = ends[i], ends[j]
        cost = _core.join_cost(p, leave, q, arrive, radius)
        if distance[i, j] < _NEAR * radius:
            # over a short gap the last nodes' noise turns the curve: look from a radius back too
            cost = min(cost, _core.join_cost(*back[i], *back[j], radius))
        if contrast is not None:
            cost += float(contrast[i, j])
        if cost < 2.0 * config.free_end and visibility is not None and distance[i, j] > 1.2 * radius:
            nodes = bridge(outward(arcs, i), outward(arcs, j)[::-1], span, 0.4 * radius)
            if distance[i, j] > config.gap * radius and visibility.occluded(nodes, radius).mean() < _MOSTLY:
                continue
            free = visibility.free(nodes, radius)
            longest = max((stop - start for start, stop in find_runs(free)), default=0) * 0.4
            if longest >= max(_THROUGH[0], _THROUGH[1] * distance[i, j] / radius):
                continue
            share = float(free.mean()) if len(nodes) else 0.0
            cost += config.seen_through * share * distance[i, j] / radius
        if cost < 2.0 * config.free_end:
            costs[i, j] = cost
    return JoinCosts(tuple(arcs), costs, config.rings != "never", contrast)


def bridge_costs(
    costs: JoinCosts, pairs: Iterable[Pair], evidence: JoinEvidence
) -> list[tuple[float, int, int]]:
    """Price bridges over gaps of any length between pairs of ends.

    Parameters
    ----------
    costs : JoinCosts
        The arcs, and what differences of colour cost.
    pairs : iterable of (int, int)
        Numbers of ends.
    evidence : JoinEvidence

    Returns
    -------
    list of (float, int, int)
        Cost and ends, the cheapest first; without pairs whose bridge leads through free space.
    """
    arcs, contrast, radius = costs.arcs, costs.contrast, evidence.radius
    priced = []
    for i, j in pairs:
        before, after = outward(arcs, i), outward(arcs, j)[::-1]
        nodes = least_bending(before, after, evidence)
        gap = float(np.linalg.norm(after[0] - before[-1]))
        way = np.vstack([before[-1:], nodes, after[:1]])
        if seen_through(way, evidence):
            continue
        turn = 4.0 - 2.0 * (
            end_direction(before, 0.0, 1.5 * radius) - end_direction(after[::-1], 0.0, 1.5 * radius)
        ) @ (after[0] - before[-1]) / max(gap, 1e-12)
        cost = 8.0 * bridge_cost(way, evidence) + turn + 0.25 * gap / radius
        if contrast is not None:
            cost += contrast[i, j]
        priced.append((float(cost), i, j))
    return sorted(priced)


def _farther_back(nodes: Array, skip: float, span: float) -> tuple[Array, Array]:
    """Place a stretch before the last node, and the direction there."""
    s = path_length(nodes)
    at = int(np.searchsorted(s, max(s[-1] - skip, 0.5 * s[-1])))
    return nodes[at], end_direction(nodes[: at + 1], 0.0, span)
