"""Hypotheses: ways to make ropes of arcs, each fitted to the points and compared with the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from strand._core import NotEnoughDataError, TubeFit
from strand.geometry.polyline import order_segments, path_length
from strand.reconstruction.courses import Chains, have_same_courses
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.arc_repair import cut_at_contacts, drop_duplicates, turn_stubs
from strand.reconstruction.tubes.chaining import chain_arcs, chain_arcs_to_length
from strand.reconstruction.tubes.clouds import Pair
from strand.reconstruction.tubes.join_costs import JoinCosts, price_bridges, price_joins
from strand.reconstruction.tubes.matching import join_most, join_until, list_free_ends, match_ends
from strand.reconstruction.tubes.scores import price_contradictions, price_explanation
from strand.support.checks import Array
from strand.support.lazy import lazy_property

_CUT_BACK = (2.5, 6.0)  # radii: ends are cut back this far where arcs run into each other
_OBVIOUS_COST = 1.25  # cost of each end up to which a join is obvious
_MAX_ARCS = 200  # more are no ropes
_MAX_EFFORT = 15_000  # sum of the squared numbers of arcs of all hypotheses but the last
_MAX_BRIDGES = 1000  # pairs of ends: of more, only those of near ends are priced
_MIN_PARTNERS = 4  # nearest ends that each end is priced with in any case
_DOUBTFUL_COST = 8.0  # joins without which the matching costs up to this more are tried without
_MAX_DOUBTFUL = 4  # joins that are tried without


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One way to make ropes of arcs.

    Attributes
    ----------
    costs : JoinCosts
        The arcs, and the costs of joining them.
    joins : tuple of (int, int)
        Pairs of ends that are joined.
    chains : list of ((K, 3) ndarray, bool)
        Nodes of each rope, metres, and whether it is closed.
    matching_cost : float
        Cost of all joins and free ends.
    dropped : tuple of (K, 3) ndarray
        Nodes of the ropes that are too short, metres.
    radius : float
        Radius of the ropes, metres.
    free_end : float
        Cost of an end that is not joined.
    """

    costs: JoinCosts
    joins: tuple[Pair, ...]
    chains: Chains
    matching_cost: float
    dropped: tuple[Array, ...]
    radius: float
    free_end: float

    @lazy_property
    def detours(self) -> dict[Pair, tuple[list[Pair], float]]:
        """The joins of least cost without each of its own, and that cost."""
        return {pair: match_ends(self.costs, self.free_end, [pair]) for pair in self.joins}


@dataclass(frozen=True, eq=False)
class ScoredHypothesis:
    """A hypothesis and what it costs.

    Attributes
    ----------
    hypothesis : Hypothesis
    price : callable
        Fits the hypothesis; returns the price of the explanation in radii of rope, and of different colours
        at joins.
    contradiction : float
        Price of contradictions to the known facts about the ropes.
    """

    hypothesis: Hypothesis
    price: Callable[[], float]
    contradiction: float

    @lazy_property
    def cost(self) -> float:
        """The sum of both prices; a hypothesis without rivals need not be fitted."""
        return self.price() + self.contradiction


def make_hypothesis(
    costs: JoinCosts, evidence: JoinEvidence, without: Sequence[Pair] = ()
) -> Hypothesis | None:
    """Join arcs by the matching of least cost; None if no rope is long enough.

    If there are more ropes than known, or open ones that are known to be rings, longer gaps are bridged too.
    The matching does not join the pairs in `without`.
    """
    config, radius, prior, arcs = evidence.config, evidence.radius, evidence.prior, costs.arcs
    joins, cost = match_ends(costs, config.free_end, without)

    def is_long_enough(chain: tuple[Array, bool]) -> bool:
        return bool(path_length(chain[0])[-1] > config.min_length * radius)

    made = chain_arcs(arcs, joins, evidence)
    if prior.ropes is not None and sum(map(is_long_enough, made)) > prior.ropes:
        chain_of = _number_open_chains(made, joins, len(arcs), config.min_length * radius)
        # a bridge may still join a pair that the matching may not
        barred = [pair for pair in without if pair not in costs.costs]
        pairs = [
            (i, j)
            for i, j in combinations(list_free_ends(joins, chain_of), 2)
            if chain_of[i // 2] != chain_of[j // 2] and (i, j) not in barred
        ]
        priced = price_bridges(costs, _keep_nearest(costs, pairs), evidence)
        joins = [*joins, *join_until(prior.ropes, priced, chain_of)]
        made = chain_arcs(arcs, joins, evidence)
    if config.rings == "always" and not all(closed for _, closed in made):
        chain_of = _number_open_chains(made, joins, len(arcs), config.loop * radius)
        # if the number of ropes is known, each chain is a ring of its own
        pairs = [
            (i, j)
            for i, j in combinations(list_free_ends(joins, chain_of), 2)
            if prior.ropes is None or chain_of[i // 2] == chain_of[j // 2]
        ]
        priced = price_bridges(costs, _keep_nearest(costs, pairs), evidence)
        joins = [*joins, *join_most(priced, len(arcs))]
        made = chain_arcs(arcs, joins, evidence)
    if prior.lengths:
        made = chain_arcs_to_length(arcs, joins, evidence)
    chains = [chain for chain in made if is_long_enough(chain)]
    dropped = tuple(chain[0] for chain in made if not is_long_enough(chain))
    if not chains:
        return None
    return Hypothesis(costs, tuple(joins), chains, cost, dropped, radius, config.free_end)


def _keep_nearest(costs: JoinCosts, pairs: Sequence[Pair]) -> Sequence[Pair]:
    """Return pairs of ends; of more than can be priced, those with each end's nearest partners."""
    if len(pairs) <= _MAX_BRIDGES:
        return pairs
    each = max(_MAX_BRIDGES // len({end for pair in pairs for end in pair}), _MIN_PARTNERS)
    partners: dict[int, int] = {}
    kept = []
    for pair in sorted(
        pairs, key=lambda pair: float(np.linalg.norm(costs.locate_end(pair[0]) - costs.locate_end(pair[1])))
    ):
        if min(partners.get(end, 0) for end in pair) < each:
            kept.append(pair)
        for end in pair:
            partners[end] = partners.get(end, 0) + 1
    return sorted(kept)


def _number_open_chains(made: Chains, joins: Sequence[Pair], arcs: int, least: float) -> list[int]:
    """Return for each arc the number of its chain if that is open and longer than `least`, else -1."""
    numbers = [-1] * arcs
    for number, (chain, (entered, closed)) in enumerate(zip(made, order_segments(arcs, joins), strict=True)):
        for end in entered:
            enough = path_length(chain[0])[-1] > least
            numbers[end // 2] = number if enough and not closed else -1
    return numbers


@dataclass(eq=False)
class _Contest:
    """The hypotheses about one class of radius so far, none of which runs like another."""

    evidence: JoinEvidence
    fit_chains: Callable[[Chains], TubeFit]
    run: Run
    scored: list[ScoredHypothesis] = field(default_factory=list)
    effort: int = 0

    def has_time(self, arcs: int) -> bool:
        """Tell whether there is time for one more hypothesis about a number of arcs; the first has it."""
        if self.scored and (self.effort > _MAX_EFFORT or self.run.skips("other ways to join the arcs")):
            return False
        self.effort += arcs**2
        return True

    def try_arcs(self, arcs: Sequence[Array]) -> JoinCosts | None:
        """Add the hypothesis about some arcs if there is time; return what their joins cost."""
        if not self.has_time(len(arcs)):
            return None
        costs = price_joins(arcs, self.evidence)
        self._add(make_hypothesis(costs, self.evidence))
        return costs

    def try_without(self, costs: JoinCosts, pair: Pair) -> None:
        if self.has_time(len(costs.arcs)):
            self._add(make_hypothesis(costs, self.evidence, [pair]))

    def rank(self) -> list[ScoredHypothesis]:
        """Return the hypotheses, the best first."""
        if len(self.scored) < 2:
            return self.scored
        return sorted(self.scored, key=lambda one: one.cost)

    def _add(self, one: Hypothesis | None) -> None:
        """Add a hypothesis, unless it runs like another."""
        if one is None or any(
            have_same_courses(one.chains, other.hypothesis.chains, self.evidence.radius)
            for other in self.scored
        ):
            return

        def price() -> float:
            cost = price_explanation(self.fit_chains(one.chains), self.evidence.visibility)
            contrast = one.costs.contrast
            return cost if contrast is None else cost + float(sum(contrast[pair] for pair in one.joins))

        self.scored.append(ScoredHypothesis(one, price, price_contradictions(one.chains, self.evidence)))
        # fitted before anybody asks whether there is time for the next
        self.rank()


def rank_hypotheses(
    arcs: Sequence[Array], evidence: JoinEvidence, fit_chains: Callable[[Chains], TubeFit], run: Run
) -> list[ScoredHypothesis]:
    """Fit the likely hypotheses about arcs; return those that run differently, the best first.

    One without a rival is not fitted. Past the run's deadline there is only the first. Without any rope the
    result is empty.
    """
    if len(arcs) > _MAX_ARCS:
        raise NotEnoughDataError(
            f"views: {len(arcs)} pieces look like rope, at most {_MAX_ARCS} can be joined; do bounds exclude "
            "everything else?"
        )
    radius, config = evidence.radius, evidence.config
    contest = _Contest(evidence, fit_chains, run)
    arcs = turn_stubs(drop_duplicates(arcs, radius), radius)
    parted = cut_at_contacts(arcs, radius, config)
    costs = contest.try_arcs(parted)
    if len(parted) != len(arcs):
        costs = contest.try_arcs(arcs)
        for back in _CUT_BACK if contest.has_time(len(arcs)) else ():
            contest.try_arcs(cut_at_contacts(arcs, radius, config, back))
    elif [*map(len, parted)] != [*map(len, arcs)]:
        # these are shorter arcs
        costs = None
    if contest.has_time(len(arcs)):
        # with the obvious joins made first, more ends turn out to lie inside others
        costs = costs or price_joins(arcs, evidence)
        merged = [nodes for nodes, _ in chain_arcs(arcs, match_ends(costs, _OBVIOUS_COST)[0], evidence)]
        for back in _CUT_BACK if len(merged) < len(arcs) else ():
            parts = cut_at_contacts(merged, radius, config, back)
            if len(parts) <= len(merged):
                # cut back farther, there are no more of them
                break
            contest.try_arcs(parts)
    if contest.scored:
        _try_without_doubtful_joins(contest)
    return contest.rank()


def _try_without_doubtful_joins(contest: _Contest) -> None:
    """Try the best hypothesis without each join that costs little more to drop, or that may be wrong."""
    prior = contest.evidence.prior
    first = contest.rank()[0]
    best = first.hypothesis
    tries = sorted(
        (cost - best.matching_cost, pair)
        for pair, (_, cost) in best.detours.items()
        if pair in best.costs.costs
    )
    too_few = prior.ropes is not None and len(best.chains) < prior.ropes
    wrong_length = bool(prior.lengths) and first.contradiction > 0
    for more, pair in tries[:_MAX_DOUBTFUL]:
        if more < _DOUBTFUL_COST or too_few or wrong_length:
            contest.try_without(best.costs, pair)
    for pair in best.joins if wrong_length else ():
        if pair not in best.costs.costs:
            contest.try_without(best.costs, pair)


def measure_prior_cost(scored: Sequence[ScoredHypothesis]) -> float:
    """Return how much less the best hypothesis would cost if nothing were known of the ropes."""
    if len(scored) < 2:
        return 0.0
    free = [one.cost - one.contradiction for one in scored]
    return free[0] - min(free)
