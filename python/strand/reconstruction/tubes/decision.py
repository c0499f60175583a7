"""Decide how arcs are joined, for each class of radius, by hypotheses fitted to a sample of the points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np

from strand._core import NotEnoughDataError, TubeFit
from strand.config import Config
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.orientation import rotate_ring
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.arcs import keep_explaining
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.reconstruction.tubes.fitting import ROPE_MARGIN, ROUGH_TOLERANCE, fit_curves, make_splines
from strand.reconstruction.tubes.hypotheses import ScoredHypothesis, rank_hypotheses
from strand.reconstruction.tubes.joins import ByClass
from strand.reconstruction.tubes.known_length import restore_bows
from strand.reconstruction.tubes.scores import price_explanation

_MIN_GAIN = 1.0  # a decision is changed only if that lowers the cost by more than this


def decide_joins(
    clouds: Clouds, arcs: Arcs, before: TubeFit, evidence: JoinEvidence, config: Config, run: Run
) -> list[list[ScoredHypothesis]]:
    """Rank hypotheses about the arcs of each class of radius, the best first; none for one without arcs.

    The poses and radii of `before`, the fit of the arcs, are kept.
    """
    by_class: list[list[ScoredHypothesis]] = []
    for number, radius in enumerate(before.radii):
        mine = [nodes for nodes, its in zip(arcs.nodes, arcs.classes, strict=True) if its == number]
        if not mine:
            by_class.append([])
            continue
        of_class = evidence.select_class(float(radius), len(before.radii))
        fit_chains = _make_fit(clouds, before, number, evidence, config)
        by_class.append(rank_hypotheses(mine, of_class, fit_chains, run))
    if not any(by_class):
        raise NotEnoughDataError("views: the points make no rope; is the radius right, in metres?")
    return by_class


def _make_fit(
    clouds: Clouds, before: TubeFit, number: int, evidence: JoinEvidence, config: Config
) -> Callable[[Chains], TubeFit]:
    """Return a function that fits ropes of one class of radius to a sample of its points at fixed poses."""
    radius = before.radii[number : number + 1]

    @cache
    def take_sample() -> Clouds:
        # only when it is asked for: a hypothesis without a rival is not fitted
        points = clouds if len(before.radii) == 1 else _select_class(clouds, before, number)
        return points.thin_for_tracing(float(radius[0]))

    def fit_chains(chains: Chains) -> TubeFit:
        ropes = Arcs([nodes for nodes, _ in chains], [0] * len(chains))
        curves = make_splines(ropes, radius, config, ROPE_MARGIN)
        fit = fit_curves(
            take_sample(),
            curves,
            ropes.classes,
            before.motions,
            radius,
            config,
            band=(0.5, 0.4),
            iterations=12,
            tolerance=ROUGH_TOLERANCE,
            uncertainty=False,
        )
        return fit.replace(curves=restore_bows(fit, curves)) if evidence.prior.lengths else fit

    return fit_chains


def _select_class(clouds: Clouds, fit: TubeFit, number: int) -> Clouds:
    """Return the points that arcs of one class of radius explain."""
    mine = fit.explained & (fit.radius_classes[fit.curve] == number)
    ends = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    kept = [cloud[chosen] for cloud, chosen in zip(clouds.points, np.split(mine, ends), strict=True)]
    return replace(clouds, points=kept)


def reconsider_joins(
    by_class: ByClass,
    arcs: Arcs,
    clouds: Clouds,
    before: TubeFit,
    evidence: JoinEvidence,
    config: Config,
    run: Run,
) -> list[list[ScoredHypothesis]] | None:
    """Rank hypotheses about other arcs; None if the best of them are not better than before.

    The points are divided among the classes of radius anew, so the best hypotheses are priced again.
    """
    if len(before.radii) > 1:
        motions, radii = before.motions, before.radii
        arcs = keep_explaining(clouds, motions, radii, arcs, config)
        before = fit_curves(
            clouds,
            make_splines(arcs, radii, config, 0.5),
            arcs.classes,
            motions,
            radii,
            config,
            band=(0.5, 0.4),
            iterations=8,
            uncertainty=False,
        )
    again = decide_joins(clouds, arcs, before, evidence, config, run)
    if not all(by_class) or not all(again):
        return None
    if len(before.radii) > 1:
        fits = [_make_fit(clouds, before, number, evidence, config) for number in range(len(by_class))]
        costs = [
            price_explanation(fit_chains(scored[0].hypothesis.chains), evidence.visibility)
            for fit_chains, scored in zip(fits, by_class, strict=True)
        ]
    else:
        costs = [scored[0].cost for scored in by_class]
    return again if sum(scored[0].cost for scored in again) < sum(costs) - _MIN_GAIN else None


def choose_ropes(by_class: ByClass) -> tuple[Arcs, list[bool]]:
    """Return the ropes of the best hypotheses, and which of them are rings."""
    chains = [
        (chain, number)
        for number, scored in enumerate(by_class)
        if scored
        for chain in scored[0].hypothesis.chains
    ]
    nodes = [rotate_ring(nodes) if ring else nodes for (nodes, ring), _ in chains]
    return Arcs(nodes, [number for _, number in chains]), [ring for (_, ring), _ in chains]
