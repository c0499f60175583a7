"""Chains made of arcs: arcs cut back where they overlap, bridges over the gaps between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.geometry.polyline import bridge, order_segments, path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.tubes.bridges import LONG, least_bending, seen_through
from strand.reconstruction.tubes.clouds import Pair
from strand.support.checks import Array


def chained(arcs: Sequence[Array], joins: Sequence[Pair], evidence: JoinEvidence) -> Chains:
    """Make chains of arcs.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    joins : sequence of (int, int)
        Pairs of ends.
    evidence : JoinEvidence

    Returns
    -------
    list of ((K, 3) ndarray, bool)
        Nodes of each chain in order, metres, with cubics over the gaps, and whether it closes on itself:
        then its last node is its first again.
    """
    return [(_strung(parts, closed, evidence, None)[0], closed) for parts, closed in _parts(arcs, joins)]


def chained_to_length(arcs: Sequence[Array], joins: Sequence[Pair], evidence: JoinEvidence) -> Chains:
    """Make chains of arcs as `chained` does, with bridges over long gaps as long as known lengths leave."""
    ropes = _parts(arcs, joins)
    made = [_strung(parts, closed, evidence, 1.0) for parts, closed in ropes]
    lengths = [float(path_length(nodes)[-1]) for nodes, _ in made]
    for k, true in enumerate(evidence.prior.expected(lengths)):
        _, gaps = made[k]
        if true is not None and gaps > 0 and true > lengths[k]:
            made[k] = _strung(*ropes[k], evidence, 1.0 + (true - lengths[k]) / gaps)
    return [(nodes, closed) for (nodes, _), (_, closed) in zip(made, ropes, strict=True)]


def _parts(arcs: Sequence[Array], joins: Sequence[Pair]) -> list[tuple[list[Array], bool]]:
    """Arcs of each chain in order, their nodes too, and whether it is closed."""
    return [
        ([arcs[end // 2][:: -1 if end % 2 else 1] for end in entered], closed)
        for entered, closed in order_segments(len(arcs), joins)
    ]


def _cut_back(nodes: Array, other: Array, radius: float) -> Array:
    """Drop up to six last nodes that are nearer than 1.5 radii to a place; four are always left."""
    near = np.linalg.norm(nodes[-6:] - other, axis=1) < 1.5 * radius
    count = len(near) if near.all() else len(near) - (int(np.flatnonzero(~near)[-1]) + 1)
    return nodes[: max(len(nodes) - count, min(len(nodes), 4))]


def _strung(
    parts: Sequence[Array], closed: bool, evidence: JoinEvidence, stretch: float | None
) -> tuple[Array, float]:
    """One chain of several arcs, and the length of its bridges that could be longer.

    Arcs are cut back where they overlap, with a cubic between. Long bridges are made longer by the factor
    `stretch`; without it they are not measured.
    """
    radius = evidence.radius
    longer = 0.0

    def bridged(before: Array, after: Array, nodes: Array) -> Array:
        nonlocal longer
        if stretch is None:
            return nodes
        way = np.vstack([before[-1:], nodes, after[:1]])
        length = float(path_length(way)[-1])
        if length < LONG * radius or seen_through(way, evidence):
            return nodes
        longer += length
        if stretch == 1.0:
            return nodes
        return least_bending(before, after, evidence, stretch * length)

    nodes = parts[0]
    for part in parts[1:]:
        before = _cut_back(nodes, part[0], radius)
        after = _cut_back(part[::-1], before[-1], radius)[::-1]
        between = bridged(before, after, least_bending(before, after, evidence))
        nodes = np.vstack([before, between, after])
    if closed:
        nodes = _cut_back(nodes, nodes[0], radius)
        between = bridged(nodes, nodes, bridge(nodes, nodes, 1.5 * radius, 0.4 * radius))
        nodes = np.vstack([nodes, between, nodes[:1]])
    return nodes, longer
