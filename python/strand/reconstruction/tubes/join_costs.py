"""Price joins of arcs' ends by the curves that would join them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

import strand._core as _core
from strand.geometry.polyline import bridge, end_direction, find_runs, path_length
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.bridges import (
    BRIDGE_SPACING,
    DIRECTION_SPAN,
    is_seen_through,
    make_bridge,
    price_bridge,
)
from strand.reconstruction.tubes.clouds import Pair
from strand.support.checks import Array

_SHORT_GAP = 2.5  # radii: over shorter gaps noise turns the ends
_MIN_VISIBLE = 1.2  # radii: over shorter gaps no free space is searched
_UNSEEN_FACTOR = 1.7  # times `Linking.gap`: how long gaps may be that no camera could see
_MIN_OCCLUDED = 0.8  # share of a gap without which cameras could see it
_MAX_FREE = 1.0  # radii: a gap with a longer free stretch is not bridged
_MAX_FREE_SHARE = 0.3  # of the gap: or with a stretch of a larger share, if that is longer
_BENDING = 8.0  # cost of a bridge's bending energy, in radii
_TURN = 2.0  # cost of turning by a right angle at an end of a bridge
_LENGTH = 0.25  # cost of each radius of a bridge


@dataclass(frozen=True, eq=False)
class JoinCosts:
    """The cost of joining each pair of ends: end 2k is the first node of arc k, 2k + 1 its last.

    Attributes
    ----------
    arcs : tuple of (M, 3) ndarray
        Ordered nodes, metres.
    costs : dict of (int, int) to float
        Costs of the pairs that are cheaper to join than to leave.
    rings : bool
        Whether joins may close rings.
    contrast : (E, E) ndarray or None
        The part of each pair's cost that its ends' different colours make, if colours are known.
    """

    arcs: tuple[Array, ...]
    costs: dict[Pair, float]
    rings: bool = True
    contrast: Array | None = None

    def locate_end(self, number: int) -> Array:
        """Return (3,) the place of an end, metres."""
        return np.asarray(self.arcs[number // 2][-1 if number % 2 else 0])


def order_outward(arcs: Sequence[Array], end: int) -> Array:
    """Return the nodes of an arc in the order in which they lead to one of its ends."""
    return arcs[end // 2][:: 1 if end % 2 else -1]


def price_joins(arcs: Sequence[Array], evidence: JoinEvidence) -> JoinCosts:
    """Price all joins over gaps of usual length by the curves that would make them.

    A join costs what the kernel `price_join` returns, plus a price for free space and for different colours.
    """
    radius, config, visibility = evidence.radius, evidence.config, evidence.visibility
    span = DIRECTION_SPAN * radius
    ends = [(nodes[-1], end_direction(nodes, 0.0, span)) for arc in arcs for nodes in (arc[::-1], arc)]
    position = np.array([p for p, _ in ends]).reshape(-1, 3)
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    # gaps that no camera could see may be longer
    farthest = config.gap * radius * (1.0 if visibility is None else _UNSEEN_FACTOR)
    contrast = None if evidence.colors is None else evidence.colors.price_joins(arcs, radius)
    costs: dict[tuple[int, int], float] = {}
    for i, j in np.argwhere(distance <= farthest).tolist():
        if j <= i:
            continue
        ring = i ^ 1 == j
        if ring and (config.rings == "never" or path_length(arcs[i // 2])[-1] < config.loop * radius):
            continue
        (p, leave), (q, arrive) = ends[i], ends[j]
        cost = _core.price_join(p, leave, q, arrive, radius)
        if distance[i, j] < _SHORT_GAP * radius:
            # over a short gap the last nodes' noise turns the curve: start a radius before them too
            (p, leave), (q, arrive) = (_step_back(order_outward(arcs, end), radius, span) for end in (i, j))
            cost = min(cost, _core.price_join(p, leave, q, arrive, radius))
        if contrast is not None:
            cost += float(contrast[i, j])
        if cost < 2.0 * config.free_end and visibility is not None and distance[i, j] > _MIN_VISIBLE * radius:
            before, after = order_outward(arcs, i), order_outward(arcs, j)[::-1]
            nodes = bridge(before, after, span, BRIDGE_SPACING * radius)
            cost += _price_free_space(nodes, distance[i, j], visibility, evidence)
        if cost < 2.0 * config.free_end:
            costs[i, j] = cost
    return JoinCosts(tuple(arcs), costs, config.rings != "never", contrast)


def _price_free_space(nodes: Array, gap: float, visibility: Visibility, evidence: JoinEvidence) -> float:
    """Return the price of a bridge's share in free space; infinite where no rope can be."""
    radius, config = evidence.radius, evidence.config
    if gap > config.gap * radius and visibility.occluded(nodes, radius).mean() < _MIN_OCCLUDED:
        return float("inf")
    free = visibility.free(nodes, radius)
    longest = max((stop - start for start, stop in find_runs(free)), default=0) * BRIDGE_SPACING
    if longest >= max(_MAX_FREE, _MAX_FREE_SHARE * gap / radius):
        return float("inf")
    share = float(free.mean()) if len(nodes) else 0.0
    return config.seen_through * share * gap / radius


def price_bridges(
    costs: JoinCosts, pairs: Iterable[Pair], evidence: JoinEvidence
) -> list[tuple[float, int, int]]:
    """Price bridges over gaps of any length; return cost and ends of each, the cheapest first.

    Pairs of ends whose bridge leads through free space are dropped.
    """
    arcs, contrast, radius = costs.arcs, costs.contrast, evidence.radius
    span = DIRECTION_SPAN * radius
    priced = []
    for i, j in pairs:
        before, after = order_outward(arcs, i), order_outward(arcs, j)[::-1]
        nodes = make_bridge(before, after, evidence)
        gap = float(np.linalg.norm(after[0] - before[-1]))
        way = np.vstack([before[-1:], nodes, after[:1]])
        if is_seen_through(way, evidence):
            continue
        leave, arrive = (end_direction(nodes, 0.0, span) for nodes in (before, after[::-1]))
        turn = 2.0 * _TURN - _TURN * (leave - arrive) @ (after[0] - before[-1]) / max(gap, 1e-12)
        cost = _BENDING * price_bridge(way, evidence) + turn + _LENGTH * gap / radius
        if contrast is not None:
            cost += contrast[i, j]
        priced.append((float(cost), i, j))
    return sorted(priced)


def _step_back(nodes: Array, skip: float, span: float) -> tuple[Array, Array]:
    """Return a place up to `skip` before the last node, and the direction there."""
    s = path_length(nodes)
    at = int(np.searchsorted(s, max(s[-1] - skip, 0.5 * s[-1])))
    return nodes[at], end_direction(nodes[: at + 1], 0.0, span)
