"""Hypotheses: ways to make ropes of arcs, each fitted to the points and compared with the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strand._core import NotEnoughDataError, TubeFit
from strand.geometry.polyline import order_segments, path_length
from strand.reconstruction.courses import Chains, have_same_courses
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.arc_repair import aimed, part_at_contacts, without_duplicates
from strand.reconstruction.tubes.chaining import chained, chained_to_length
from strand.reconstruction.tubes.clouds import Pair
from strand.reconstruction.tubes.join_costs import JoinCosts, bridge_costs, join_costs
from strand.reconstruction.tubes.matching import free_ends, joined_most, joined_to, matched
from strand.reconstruction.tubes.scores import contradiction_cost, explanation_cost
from strand.support.checks import Array

# ends cut back by so many radii where arcs run into each other
_CUT_BACK = (2.5, 6.0)
# what a join may cost to be obvious, for each end
_OBVIOUS = 1.25
# more arcs than this are no ropes; hypotheses follow until the squares of their numbers of arcs add up to so
# many
_MOST, _EFFORT = 200, 40_000
# of more pairs of ends than this, bridges are priced between each end and at least so many nearest others
_BRIDGED, _PARTNERS = 1000, 4
# joins whose matching costs up to this much more without them are tried without, and at most so many
_DOUBT, _TRIES = 8.0, 4


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way to make ropes of arcs.

    Attributes
    ----------
    costs : JoinCosts
        The arcs, and what joins cost.
    joins : tuple of (int, int)
        Pairs of ends that are joined.
    chains : list of ((K, 3) ndarray, bool)
        Nodes of each rope, metres, and whether it is closed.
    matching_cost : float
    left_out : tuple of (K, 3) ndarray
        Nodes of what became too short a rope, metres.
    """

    costs: JoinCosts
    joins: tuple[Pair, ...]
    chains: Chains
    matching_cost: float
    left_out: tuple[Array, ...]


@dataclass(frozen=True, eq=False)
class ScoredHypothesis:
    """A hypothesis after it was fitted.

    Attributes
    ----------
    hypothesis : Hypothesis
    fit : TubeFit
    cost : float
        What is left unexplained, what it takes to explain the rest, in radii of rope, what differences of
        colour cost at joins, and `contradiction`.
    contradiction : float
        What of it is for contradicting what is known of the ropes beforehand.
    """

    hypothesis: Hypothesis
    fit: TubeFit
    cost: float
    contradiction: float


def hypothesis(costs: JoinCosts, evidence: JoinEvidence, without: Sequence[Pair] = ()) -> Hypothesis | None:
    """Join arcs by the matching of least cost; None if that leaves no rope long enough.

    If that leaves more ropes than there are, or ropes open that are rings, longer gaps are bridged too.

    Parameters
    ----------
    costs : JoinCosts
    evidence : JoinEvidence
    without : sequence of (int, int)
        Pairs that may not be joined.

    Returns
    -------
    Hypothesis or None
    """
    config, radius, prior, arcs = evidence.config, evidence.radius, evidence.prior, costs.arcs
    joins, cost = matched(costs, config.free_end, without)

    def long_enough(chain: tuple[Array, bool]) -> bool:
        return bool(path_length(chain[0])[-1] > config.min_length * radius)

    made = chained(arcs, joins, evidence)
    if prior.ropes is not None and sum(map(long_enough, made)) > prior.ropes:
        chain_of = _open_chains(made, joins, len(arcs), config.min_length * radius)
        # pairs that the matching is to do without may still be what makes the ropes so few
        barred = [pair for pair in without if pair not in costs.costs]
        pairs = [
            (i, j)
            for i, j in combinations(free_ends(joins, chain_of), 2)
            if chain_of[i // 2] != chain_of[j // 2] and (i, j) not in barred
        ]
        priced = bridge_costs(costs, _nearest(costs, pairs), evidence)
        joins = [*joins, *joined_to(prior.ropes, priced, chain_of)]
        made = chained(arcs, joins, evidence)
    if config.rings == "always" and not all(closed for _, closed in made):
        chain_of = _open_chains(made, joins, len(arcs), config.loop * radius)
        # if the number of ropes is known, each chain is a ring of its own
        pairs = [
            (i, j)
            for i, j in combinations(free_ends(joins, chain_of), 2)
            if prior.ropes is None or chain_of[i // 2] == chain_of[j // 2]
        ]
        priced = bridge_costs(costs, _nearest(costs, pairs), evidence)
        joins = [*joins, *joined_most(priced, len(arcs))]
        made = chained(arcs, joins, evidence)
    if prior.lengths:
        made = chained_to_length(arcs, joins, evidence)
    chains = [chain for chain in made if long_enough(chain)]
    left_out = tuple(chain[0] for chain in made if not long_enough(chain))
    return Hypothesis(costs, tuple(joins), chains, cost, left_out) if chains else None


def _nearest(costs: JoinCosts, pairs: Sequence[Pair]) -> Sequence[Pair]:
    """Return pairs of ends; of more than can be bridged, for each end those with the nearest others."""
    if len(pairs) <= _BRIDGED:
        return pairs
    each = max(_BRIDGED // len({end for pair in pairs for end in pair}), _PARTNERS)
    partners: dict[int, int] = {}
    kept = []
    for pair in sorted(
        pairs, key=lambda pair: float(np.linalg.norm(costs.end(pair[0]) - costs.end(pair[1])))
    ):
        if min(partners.get(end, 0) for end in pair) < each:
            kept.append(pair)
        for end in pair:
            partners[end] = partners.get(end, 0) + 1
    return sorted(kept)


def _open_chains(made: Chains, joins: Sequence[Pair], arcs: int, least: float) -> list[int]:
    """Return for each arc the number of its chain if that has ends and is longer than `least`, else -1."""
    numbers = [-1] * arcs
    for number, (chain, (entered, closed)) in enumerate(zip(made, order_segments(arcs, joins), strict=True)):
        for end in entered:
            enough = path_length(chain[0])[-1] > least
            numbers[end // 2] = number if enough and not closed else -1
    return numbers


def compared(
    arcs: Sequence[Array], evidence: JoinEvidence, fitted: Callable[[Chains], TubeFit], run: Run
) -> list[ScoredHypothesis]:
    """Fit the likely hypotheses about arcs and compare them, as many as the number of arcs allows.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    evidence : JoinEvidence
    fitted : callable
        Fits chains to the points.
    run : Run
        Its deadline leaves out all hypotheses after the first.

    Returns
    -------
    list of ScoredHypothesis
        No two alike, the best first; empty if there is no rope.

    Raises
    ------
    strand.NotEnoughDataError
        If there are so many arcs that they are no ropes.
    """
    radius, config, prior = evidence.radius, evidence.config, evidence.prior
    scored: list[ScoredHypothesis] = []
    effort = 0

    def affordable(count: int) -> bool:
        """Tell whether there is time for one more hypothesis about so many arcs."""
        nonlocal effort
        if scored and (effort > _EFFORT or run.skips("other ways to join the arcs")):
            return False
        effort += count**2
        return True

    def consider(one: Hypothesis | None) -> None:
        if one is not None and not any(
            have_same_courses(one.chains, other.hypothesis.chains, radius) for other in scored
        ):
            fit = fitted(one.chains)
            contradiction = contradiction_cost(one.chains, evidence)
            cost = explanation_cost(fit, evidence.visibility)
            contrast = one.costs.contrast
            if contrast is not None:
                cost += float(sum(contrast[pair] for pair in one.joins))
            scored.append(ScoredHypothesis(one, fit, cost + contradiction, contradiction))

    def consider_arcs(arcs: Sequence[Array]) -> None:
        if affordable(len(arcs)):
            consider(hypothesis(join_costs(arcs, evidence), evidence))

    def consider_without(costs: JoinCosts, pair: Pair) -> None:
        if affordable(len(costs.arcs)):
            consider(hypothesis(costs, evidence, [pair]))

    if len(arcs) > _MOST:
        raise NotEnoughDataError(
            f"views: {len(arcs)} pieces look like rope, more than can be put together; does the extraction "
            "range (bounds) leave out everything else?"
        )
    arcs = aimed(without_duplicates(arcs, radius), radius)
    parted = part_at_contacts(arcs, radius, config)
    consider_arcs(parted)
    if len(parted) != len(arcs):
        consider_arcs(arcs)
        for back in _CUT_BACK if affordable(len(arcs)) else ():
            consider_arcs(part_at_contacts(arcs, radius, config, back))
    if affordable(len(arcs)):
        # with the obvious joins made first, more ends turn out to lie inside others
        costs = join_costs(arcs, evidence)
        merged = [nodes for nodes, _ in chained(arcs, matched(costs, _OBVIOUS)[0], evidence)]
        for back in _CUT_BACK if len(merged) < len(arcs) else ():
            parts = part_at_contacts(merged, radius, config, back)
            if len(parts) > len(merged):
                consider_arcs(parts)
    if not scored:
        return []
    first = min(scored, key=lambda one: one.cost)
    best = first.hypothesis
    tries = sorted(
        (matched(best.costs, config.free_end, [pair])[1] - best.matching_cost, pair)
        for pair in best.joins
        if pair in best.costs.costs
    )
    few = prior.ropes is not None and len(best.chains) < prior.ropes
    wrong = bool(prior.lengths) and first.contradiction > 0
    for more, pair in tries[:_TRIES]:
        if more < _DOUBT or few or wrong:
            consider_without(best.costs, pair)
    for pair in best.joins if wrong else ():
        if pair not in best.costs.costs:
            consider_without(best.costs, pair)
    return sorted(scored, key=lambda one: one.cost)


def without_prior(scored: Sequence[ScoredHypothesis]) -> float:
    """How much more the best hypothesis costs than the best one that disregards what is known beforehand.

    Parameters
    ----------
    scored : sequence of ScoredHypothesis
        The best first.

    Returns
    -------
    float
        In the unit of the costs.
    """
    free = [one.cost - one.contradiction for one in scored]
    return free[0] - min(free)
