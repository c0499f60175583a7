"""How certain the joins of an answer are, and what else could have been the answer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.config import Linking
from strand.geometry.polyline import path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.tubes.hypotheses import ScoredHypothesis
from strand.reconstruction.tubes.matching import matched
from strand.ropes.chain import Chain
from strand.ropes.doubt import Alternative, Join
from strand.support.checks import Array

ByClass = Sequence[Sequence[ScoredHypothesis]]
"""For each class of radius the hypotheses about its arcs, the best first; empty for a class without arcs."""


def all_joins(by_class: ByClass, chains: Sequence[Chain], config: Linking) -> tuple[Join, ...]:
    """Return the joins of the answer, the least certain first."""
    joins = [join for scored in filter(None, by_class) for join in joins_of(scored, chains, config)]
    return tuple(sorted(joins, key=lambda join: join.margin))


def alternatives(by_class: ByClass) -> tuple[Alternative, ...]:
    """Return the hypotheses that are not the answer, the best first, without those that explain nothing."""
    others = [
        Alternative(other.cost - scored[0].cost, tuple(nodes for nodes, _ in other.hypothesis.chains))
        for scored in filter(None, by_class)
        for other in scored[1:]
        if np.isfinite(other.cost)
    ]
    return tuple(sorted(others, key=lambda other: other.cost))


def joins_of(
    scored: Sequence[ScoredHypothesis], chains: Sequence[Chain], config: Linking
) -> tuple[Join, ...]:
    """Say how certain each join of the best hypothesis is.

    Parameters
    ----------
    scored : sequence of ScoredHypothesis
        The best first.
    chains : sequence of Chain
        What the best became.
    config : Linking

    Returns
    -------
    tuple of Join
        The least certain first.
    """
    best, radius = scored[0].hypothesis, scored[0].fit.radius(0)
    costs = best.costs
    joins = []
    for pair in best.joins:
        a, b = (costs.end(end) for end in pair)
        place = 0.5 * (a + b)
        without, cost = matched(costs, config.free_end, [pair])
        rivals = [
            other.cost for other in scored[1:] if not runs_through(other.hypothesis.chains, a, b, radius)
        ]
        margin = min([cost - best.matching_cost, *(rival - scored[0].cost for rival in rivals)])
        partner = next((other for one in without for end, other in (one, one[::-1]) if end == pair[0]), None)
        joins.append(
            Join(
                place,
                tuple(sorted({_nearest(chains, a), _nearest(chains, b)})),
                float(margin),
                None if partner is None else costs.end(partner),
            )
        )
    return tuple(sorted(joins, key=lambda join: join.margin))


def runs_through(made: Chains, a: Array, b: Array, radius: float) -> bool:
    """Tell whether one of several chains runs from one place to another."""
    for nodes, _ in made:
        s = path_length(nodes)
        at_a = s[np.linalg.norm(nodes - a, axis=1) < 2.0 * radius]
        at_b = s[np.linalg.norm(nodes - b, axis=1) < 2.0 * radius]
        most = 1.6 * float(np.linalg.norm(b - a)) + 4.0 * radius
        if len(at_a) and len(at_b) and np.abs(at_a[:, None] - at_b[None]).min() < most:
            return True
    return False


def _nearest(chains: Sequence[Chain], place: Array) -> int:
    return int(np.argmin([np.linalg.norm(chain.points - place, axis=1).min() for chain in chains]))
