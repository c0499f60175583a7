"""Rate the joins of an answer, and list the other possible answers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.geometry.polyline import path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.tubes.hypotheses import ScoredHypothesis
from strand.ropes.chain import Chain
from strand.ropes.doubt import Alternative, Join
from strand.support.checks import Array

ByClass = Sequence[Sequence[ScoredHypothesis]]
"""Hypotheses about the arcs of each class of radius, the best first; none for a class without arcs."""

_AT_PLACE = 2.0  # radii: chains this near to a place run through it
_DETOUR_FACTOR = 1.6  # times the distance of two places: a chain joins them on a way up to this long
_DETOUR_RADII = 4.0  # radii: and longer by this


def list_joins(by_class: ByClass, chains: Sequence[Chain]) -> tuple[Join, ...]:
    """Return the joins of the answer, the least certain first."""
    joins = [join for scored in filter(None, by_class) for join in _rate_joins(scored, chains)]
    return tuple(sorted(joins, key=lambda join: join.margin))


def list_alternatives(by_class: ByClass) -> tuple[Alternative, ...]:
    """Return the hypotheses that are not the answer and explain something, the best first."""
    others = [
        Alternative(other.cost - scored[0].cost, tuple(nodes for nodes, _ in other.hypothesis.chains))
        for scored in filter(None, by_class)
        for other in scored[1:]
        if np.isfinite(other.cost)
    ]
    return tuple(sorted(others, key=lambda other: other.cost))


def _rate_joins(scored: Sequence[ScoredHypothesis], chains: Sequence[Chain]) -> list[Join]:
    """Return the joins of the best hypothesis, the first, which became the chains."""
    best = scored[0].hypothesis
    costs = best.costs
    joins = []
    for pair, (without, cost) in best.detours.items():
        a, b = (costs.locate_end(end) for end in pair)
        place = 0.5 * (a + b)
        rivals = [
            other.cost for other in scored[1:] if not run_through(other.hypothesis.chains, a, b, best.radius)
        ]
        margin = min([cost - best.matching_cost, *(rival - scored[0].cost for rival in rivals)])
        partner = next((other for one in without for end, other in (one, one[::-1]) if end == pair[0]), None)
        joins.append(
            Join(
                place,
                tuple(sorted({_find_nearest(chains, a), _find_nearest(chains, b)})),
                float(margin),
                None if partner is None else costs.locate_end(partner),
            )
        )
    return joins


def run_through(made: Chains, a: Array, b: Array, radius: float) -> bool:
    """Tell whether one of several chains runs from one place to another."""
    for nodes, _ in made:
        s = path_length(nodes)
        at_a = s[np.linalg.norm(nodes - a, axis=1) < _AT_PLACE * radius]
        at_b = s[np.linalg.norm(nodes - b, axis=1) < _AT_PLACE * radius]
        most = _DETOUR_FACTOR * float(np.linalg.norm(b - a)) + _DETOUR_RADII * radius
        if len(at_a) and len(at_b) and np.abs(at_a[:, None] - at_b[None]).min() < most:
            return True
    return False


def _find_nearest(chains: Sequence[Chain], place: Array) -> int:
    distances = [_core.find_squared_distances(place[None], chain.points)[0] for chain in chains]
    return int(np.argmin(distances))
