"""Make chains of arcs: cut arcs back where they overlap, and bridge the gaps between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.geometry.polyline import bridge, order_segments, path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.tubes.bridges import (
    BRIDGE_SPACING,
    DIRECTION_SPAN,
    LONG_GAP,
    is_seen_through,
    make_bridge,
)
from strand.reconstruction.tubes.clouds import Pair
from strand.support.checks import Array

_MAX_CUT = 6  # nodes that an end is cut back at most
_OVERLAP = 1.5  # radii: nodes nearer than this to the next arc are cut
_MIN_LEFT = 4  # nodes that are always left


def chain_arcs(arcs: Sequence[Array], joins: Sequence[Pair], evidence: JoinEvidence) -> Chains:
    """Make chains of arcs, with cubics over the gaps between joined ends."""
    return [
        (_make_chain(parts, closed, evidence, None)[0], closed) for parts, closed in _list_parts(arcs, joins)
    ]


def chain_arcs_to_length(arcs: Sequence[Array], joins: Sequence[Pair], evidence: JoinEvidence) -> Chains:
    """Make chains of arcs; bows over long gaps make up for what known lengths lack."""
    ropes = _list_parts(arcs, joins)
    made = [_make_chain(parts, closed, evidence, 1.0) for parts, closed in ropes]
    lengths = [float(path_length(nodes)[-1]) for nodes, _ in made]
    for k, true in enumerate(evidence.prior.match_lengths(lengths)):
        _, gaps = made[k]
        if true is not None and gaps > 0 and true > lengths[k]:
            made[k] = _make_chain(*ropes[k], evidence, 1.0 + (true - lengths[k]) / gaps)
    return [(nodes, closed) for (nodes, _), (_, closed) in zip(made, ropes, strict=True)]


def _list_parts(arcs: Sequence[Array], joins: Sequence[Pair]) -> list[tuple[list[Array], bool]]:
    """Return the arcs of each chain in order, with their nodes in order, and whether it is closed."""
    return [
        ([arcs[end // 2][:: -1 if end % 2 else 1] for end in entered], closed)
        for entered, closed in order_segments(len(arcs), joins)
    ]


def _cut_back(nodes: Array, other: Array, radius: float) -> Array:
    """Drop some of the last nodes that are near a place."""
    near = np.linalg.norm(nodes[: -_MAX_CUT - 1 : -1] - other, axis=1) < _OVERLAP * radius
    count = len(near) if near.all() else int(near.argmin())
    return nodes[: max(len(nodes) - count, min(len(nodes), _MIN_LEFT))]


def _make_chain(
    parts: Sequence[Array], closed: bool, evidence: JoinEvidence, stretch: float | None
) -> tuple[Array, float]:
    """Return one chain of several arcs, and the length of its bridges that could be longer, metres.

    Long bridges are made longer by the factor `stretch`. Without it, their length is not measured.
    """
    radius = evidence.radius
    longer = 0.0

    def stretch_bridge(before: Array, after: Array, nodes: Array) -> Array:
        nonlocal longer
        if stretch is None:
            return nodes
        way = np.vstack([before[-1:], nodes, after[:1]])
        length = float(path_length(way)[-1])
        if length < LONG_GAP * radius or is_seen_through(way, evidence):
            return nodes
        longer += length
        if stretch == 1.0:
            return nodes
        return make_bridge(before, after, evidence, stretch * length)

    nodes = parts[0]
    for part in parts[1:]:
        before = _cut_back(nodes, part[0], radius)
        after = _cut_back(part[::-1], before[-1], radius)[::-1]
        between = stretch_bridge(before, after, make_bridge(before, after, evidence))
        nodes = np.vstack([before, between, after])
    if closed:
        nodes = _cut_back(nodes, nodes[0], radius)
        plain = bridge(nodes, nodes, DIRECTION_SPAN * radius, BRIDGE_SPACING * radius)
        nodes = np.vstack([nodes, stretch_bridge(nodes, nodes, plain), nodes[:1]])
    return nodes, longer
