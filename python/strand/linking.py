"""Which arc goes on as which: one decision over all ends, by the cost of the curves that would join them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import rustworkx as rx

from strand.config import Linking
from strand.strings import bridge
from strand.topology import end_direction, path_length, walk
from strand.view import Array

# weights of the matching are whole numbers, in millionths of the cost
_UNIT = 1e6


def part_at_contacts(arcs: Sequence[Array], radius: float, config: Linking) -> list[Array]:
    """Cut arcs where another's end lies inside them.

    Two strands cannot be in one place, so a trace took a wrong turn there.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.
    config : Linking

    Returns
    -------
    list of (K, 3) ndarray
        The arcs, without the nodes around contacts; pieces of fewer than three nodes are left out.
    """
    lengths = [path_length(arc) for arc in arcs]
    kept = [np.ones(len(arc), dtype=bool) for arc in arcs]
    half = config.contact_gap * radius
    for i, arc in enumerate(arcs):
        for end, place in ((arc[0], 0.0), (arc[-1], lengths[i][-1])):
            for j, other in enumerate(arcs):
                distance = np.linalg.norm(other - end, axis=1)
                if i == j:
                    distance[np.abs(lengths[j] - place) < 4.0 * radius] = np.inf
                nearest = int(distance.argmin())
                s = lengths[j]
                inside = half < s[nearest] < s[-1] - half
                if inside and distance[nearest] < config.contact * radius:
                    kept[j] &= np.abs(s - s[nearest]) > half
    pieces = []
    for arc, keep in zip(arcs, kept, strict=True):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], keep, [0]])))
        pieces += [arc[a:b] for a, b in edges.reshape(-1, 2) if b - a >= 3]
    return pieces


def join_cost(p: Array, leave: Array, q: Array, arrive: Array, radius: float) -> float:
    """Cost of the curve that leaves the end p along `leave` and meets the end q, which points along `arrive`.

    For a gap L bent by the angles a and b at its two ends it is 2 (a^2 + b^2), the bending energy of a cubic
    (8 r / L) (a^2 + b^2 - a b), and 0.25 L / r. Ends that touch or overlap cost their turn and their sideways
    offset. Infinite where the curve would have to turn back.
    """
    step = q - p
    gap = float(np.linalg.norm(step))
    if gap < 1.2 * radius:
        turn = np.arccos(np.clip(-leave @ arrive, -1.0, 1.0))
        aside = np.linalg.norm(step - (step @ leave) * leave)
        return float(1.5 * turn**2 + 0.5 * (aside / (0.5 * radius)) ** 2)
    straight = step / gap
    a = np.arccos(np.clip(leave @ straight, -1.0, 1.0))
    b = np.arccos(np.clip(-arrive @ straight, -1.0, 1.0))
    if max(a, b) > 1.4:
        return float("inf")
    together = np.cross(leave, straight) @ np.cross(straight, -arrive)
    energy = 8.0 * radius / gap * (a * a + b * b - together)
    return float(2.0 * (a * a + b * b) + energy + 0.25 * gap / radius)


def link(arcs: Sequence[Array], radius: float, config: Linking) -> list[tuple[Array, bool]]:
    """Join arcs to chains by the matching of all their ends that costs least.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.
    config : Linking

    Returns
    -------
    list of ((K, 3) ndarray, bool)
        Nodes of each chain in order, metres, with cubics over the gaps, and whether it closes on itself: then
        its last node is its first again.
    """
    span = 1.5 * radius
    ends = [(nodes[-1], end_direction(nodes, 0.0, span)) for arc in arcs for nodes in (arc[::-1], arc)]
    graph = rx.PyGraph()
    graph.add_nodes_from(range(len(ends)))
    for i, j in combinations(range(len(ends)), 2):
        (p, leave), (q, arrive) = ends[i], ends[j]
        own = i ^ 1 == j and path_length(arcs[i // 2])[-1] < config.loop * radius
        if own or np.linalg.norm(p - q) > config.gap * radius:
            continue
        gain = 2.0 * config.free_end - join_cost(p, leave, q, arrive, radius)
        if gain > 0:
            graph.add_edge(i, j, round(gain * _UNIT))
    joins = sorted(rx.max_weight_matching(graph, weight_fn=int))
    chains = []
    for entered, closed in walk(len(arcs), joins):
        parts = [arcs[end // 2][:: -1 if end % 2 else 1] for end in entered]
        nodes = parts[0]
        for part in parts[1:]:
            nodes = _joined(nodes, part, radius)
        if closed:
            nodes = _cut_back(nodes, nodes[0], radius)
            nodes = np.vstack([nodes, bridge(nodes, nodes, 1.5 * radius, 0.4 * radius), nodes[:1]])
        chains.append((nodes, closed))
    return chains


def _cut_back(nodes: Array, other: Array, radius: float) -> Array:
    """Drop up to six last nodes that are nearer than 1.5 radii to a place; four are always left."""
    near = np.linalg.norm(nodes[-6:] - other, axis=1) < 1.5 * radius
    count = len(near) if near.all() else len(near) - (int(np.flatnonzero(~near)[-1]) + 1)
    return nodes[: max(len(nodes) - count, min(len(nodes), 4))]


def _joined(before: Array, after: Array, radius: float) -> Array:
    """One chain of two, cut back where they overlap, with a cubic between."""
    before = _cut_back(before, after[0], radius)
    after = _cut_back(after[::-1], before[-1], radius)[::-1]
    return np.vstack([before, bridge(before, after, 1.5 * radius, 0.4 * radius), after])
