"""One decision for each class of radius: the hypotheses about its arcs, fitted to a sample of the points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from strand._core import NotEnoughDataError, TubeFit
from strand.config import Config
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.orientation import started
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes.arcs import explaining
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.reconstruction.tubes.fitting import ROPE_MARGIN, ROUGHLY, fitted, splines
from strand.reconstruction.tubes.hypotheses import ScoredHypothesis, compared
from strand.reconstruction.tubes.joins import ByClass
from strand.reconstruction.tubes.known_length import bowed
from strand.reconstruction.tubes.scores import explanation_cost

# a decision is made again only if that lowers the cost by more than this
_BETTER = 1.0


def decided(
    clouds: Clouds, arcs: Arcs, before: TubeFit, evidence: JoinEvidence, config: Config, run: Run
) -> list[list[ScoredHypothesis]]:
    """Fit and compare hypotheses about the arcs of each class of radius.

    Parameters
    ----------
    clouds : Clouds
    arcs : Arcs
    before : TubeFit
        The fit of the arcs, whose poses and radii are kept.
    evidence : JoinEvidence
        Of all classes together.
    config : Config
    run : Run
        Its deadline leaves out all but the first hypothesis of a class.

    Returns
    -------
    list of list of ScoredHypothesis
        For each class the best first; empty for one without arcs.

    Raises
    ------
    strand.NotEnoughDataError
        If no rope is long enough.
    """
    by_class: list[list[ScoredHypothesis]] = []
    for number, radius in enumerate(before.radii):
        mine = [nodes for nodes, its in zip(arcs.nodes, arcs.classes, strict=True) if its == number]
        if not mine:
            by_class.append([])
            continue
        of_class = evidence.of_class(float(radius), len(before.radii))
        fit_chains = _fit_to_sample(clouds, before, number, evidence, config)
        by_class.append(compared(mine, of_class, fit_chains, run))
    if not any(by_class):
        raise NotEnoughDataError("views: the points make no rope; is the radius right, in metres?")
    return by_class


def _fit_to_sample(
    clouds: Clouds, before: TubeFit, number: int, evidence: JoinEvidence, config: Config
) -> Callable[[Chains], TubeFit]:
    """Return what fits ropes of one class of radius to a sample of its points, poses as they are."""
    points = clouds if len(before.radii) == 1 else _of_class(clouds, before, number)
    radius = before.radii[number : number + 1]
    sample = points.thinned(float(radius[0]))

    def fit_chains(chains: Chains) -> TubeFit:
        ropes = Arcs([nodes for nodes, _ in chains], [0] * len(chains))
        curves = splines(ropes, radius, config, ROPE_MARGIN)
        fit = fitted(
            sample,
            curves,
            ropes.classes,
            before.motions,
            radius,
            config,
            band=(0.5, 0.4),
            iterations=12,
            tolerance=ROUGHLY,
            uncertainty=False,
        )
        return fit.replace(curves=bowed(fit, curves)) if evidence.prior.lengths else fit

    return fit_chains


def _of_class(clouds: Clouds, fit: TubeFit, number: int) -> Clouds:
    """Points that arcs of one class of radius explain."""
    mine = fit.explained & (fit.radius_classes[fit.curve] == number)
    ends = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    kept = [cloud[chosen] for cloud, chosen in zip(clouds.points, np.split(mine, ends), strict=True)]
    return replace(clouds, points=kept)


def decided_again(
    by_class: ByClass,
    arcs: Arcs,
    clouds: Clouds,
    before: TubeFit,
    evidence: JoinEvidence,
    config: Config,
    run: Run,
) -> list[list[ScoredHypothesis]] | None:
    """Fit and compare hypotheses about other arcs; None if that pays for no class of radius.

    Which points are of which class is found anew, so the hypothesis that was best is judged on them too.
    """
    if len(before.radii) > 1:
        motions, radii = before.motions, before.radii
        arcs = explaining(clouds, motions, radii, arcs, config)
        before = fitted(
            clouds,
            splines(arcs, radii, config, 0.5),
            arcs.classes,
            motions,
            radii,
            config,
            band=(0.5, 0.4),
            iterations=8,
            uncertainty=False,
        )
    again = decided(clouds, arcs, before, evidence, config, run)
    if not all(by_class) or not all(again):
        return None
    costs = [scored[0].cost for scored in by_class]
    if len(before.radii) > 1:
        for number, scored in enumerate(by_class):
            fit_chains = _fit_to_sample(clouds, before, number, evidence, config)
            costs[number] = explanation_cost(fit_chains(scored[0].hypothesis.chains), evidence.visibility)
    return again if sum(scored[0].cost for scored in again) < sum(costs) - _BETTER else None


def chosen(by_class: ByClass) -> tuple[Arcs, list[bool]]:
    """Return the ropes of the best hypotheses, and which of them are rings."""
    chains = [
        (chain, number)
        for number, scored in enumerate(by_class)
        if scored
        for chain in scored[0].hypothesis.chains
    ]
    nodes = [started(nodes) if ring else nodes for (nodes, ring), _ in chains]
    return Arcs(nodes, [number for _, number in chains]), [ring for (_, ring), _ in chains]
