"""The tubes branch of the default method: register, trace arcs, decide how they join, fit whole ropes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand._core import EndObservation, NotEnoughDataError, TubeFit
from strand.config import Config
from strand.geometry.curve import Curve
from strand.reconstruction.evidence.answer_warnings import warn_about_answer
from strand.reconstruction.evidence.color import ArcColors, collect_colors
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.visibility import Visibility, sort_rays
from strand.reconstruction.radius import Radii, add_noise_deviation
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.tubes.arcs import add_unexplained, cut_to_seen, fit_arcs
from strand.reconstruction.tubes.clouds import Arcs, Clouds
from strand.reconstruction.tubes.decision import choose_ropes, decide_joins, reconsider_joins
from strand.reconstruction.tubes.fit_warnings import warn_about_fit
from strand.reconstruction.tubes.joins import ByClass, list_alternatives, list_joins
from strand.reconstruction.tubes.noise import Noise, expect_noise
from strand.reconstruction.tubes.pixels import Cameras
from strand.reconstruction.tubes.registration import register_roughly
from strand.reconstruction.tubes.second_look import find_arcs_to_reconsider
from strand.reconstruction.tubes.tube_doubts import find_tube_doubts
from strand.reconstruction.tubes.tube_ends import extend_hidden_ends, measure_unseen
from strand.reconstruction.tubes.tube_nodes import make_chains
from strand.reconstruction.tubes.whole_ropes import cut_to_ropes, fit_ropes

SECOND_LOOK = "a second look at unexplained points"
"""Name of the work that a deadline may skip."""

_DENSE = 100  # points for each that tracing takes: more are left out
_MAX_REVISIONS = 1  # decisions that are reconsidered after the fit of the ropes


@dataclass(frozen=True, eq=False)
class _Ropes:
    """Decided joins, and the fit of the ropes that they make."""

    by_class: ByClass
    nodes: Arcs
    closed: list[bool]
    fit: TubeFit
    noise: Noise
    ends: list[EndObservation]
    parts: list[Curve | None]


def find_chains(observed: Observed, config: Config, run: Run) -> Found:
    """Trace, register, fit and join on filtered views that all see something.

    The stages are "registered" (points at the corrected poses), "arcs" (seen stretches of ropes before they
    are joined) and "fit" (the last `TubeFit`). Raises NotEnoughDataError if the points show no tube.
    """
    try:
        return _find_ropes(observed, config, run)
    except NotEnoughDataError:
        if not observed.radii.free:
            raise
        # strands that lie side by side everywhere look like thicker ones
        return _find_ropes(replace(observed, radii=observed.radii.add_parts()), config, run)


def _find_ropes(observed: Observed, config: Config, run: Run) -> Found:
    radii = observed.radii
    thinnest = float(radii.values.min())
    clouds, step = _take_clouds(observed, thinnest)
    if step >= 2 * _DENSE:
        # sparse views beside dense ones need all their points
        alone = [replace(clouds, points=[own]).find_step(thinnest) for own in clouds.points]
        # noise is correlated between neighbours, so pairs of them stay
        steps = [max(min(len(alone) * own, step) // _DENSE, 1) for own in alone]
        observed = _thin_views(observed, steps, together=2)
        clouds, step = _take_clouds(observed, thinnest)
    cameras = Cameras(observed.views, observed.whole)
    given = None
    if config.sensor is not None:
        given = expect_noise(config.sensor, cameras, thinnest, config.tubes.spacing)
        config = replace(config, sensor=None, tubes=replace(config.tubes, noise=given.sd))
    with run.stage("register"):
        few = clouds.thin(step)
        motions = register_roughly(few, radii.values, config)
    if run.skips("most of the points"):
        observed = _thin_views(observed, [step] * len(observed.views))
        clouds, cameras = few, Cameras(observed.views, observed.whole)
    with run.stage("arcs"):
        fit, radii = fit_arcs(clouds, few, motions, radii, config, run)
        before = fit if run.skips(SECOND_LOOK) else add_unexplained(clouds, fit, config)
        arcs = cut_to_seen(before, config)
    with run.stage("link"):
        evidence, visibility = _gather_evidence(observed, before, config)
        by_class: ByClass = decide_joins(clouds, arcs, before, evidence, config, run)
    for revisions in range(1 + _MAX_REVISIONS):
        nodes, closed = choose_ropes(by_class)
        with run.stage("fit"):
            fit, noise, ends = fit_ropes(clouds, cameras, nodes, closed, before, radii, given, config, run)
        with run.stage("ends"):
            parts = cut_to_ropes(fit, nodes, closed, before, observed.prior, config)
            ropes = _Ropes(by_class, nodes, closed, fit, noise, ends, parts)
            other_arcs = None
            if revisions < _MAX_REVISIONS and not run.skips(SECOND_LOOK):
                as_before = fit.replace(
                    radius_classes=np.array(nodes.classes),
                    radii=before.radii,
                    radii_sd=before.radii_sd,
                    bands=before.bands,
                )
                other_arcs = find_arcs_to_reconsider(as_before, parts, visibility)
        if other_arcs is None:
            break
        with run.stage("link"):
            revised = reconsider_joins(by_class, other_arcs, clouds, before, evidence, config, run)
        if revised is None:
            break
        by_class = revised
    found = _build_answer(ropes, radii, visibility, observed, config, run)
    starts = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    registered = tuple(np.split(ropes.fit.points, starts))
    return replace(found, stages={"registered": registered, "arcs": tuple(arcs.nodes), "fit": ropes.fit})


def _take_clouds(observed: Observed, thinnest: float) -> tuple[Clouds, int]:
    """Return the points, and the step of those that tracing takes; `thinnest` is a radius, metres."""
    clouds = Clouds.from_views(observed.views, observed.bounds, observed.held)
    return clouds, clouds.find_step(thinnest)


def _gather_evidence(observed: Observed, fit: TubeFit, config: Config) -> tuple[JoinEvidence, Visibility]:
    """Return the evidence for joins at the poses of a fit of arcs."""
    poses = [motion @ view.pose for motion, view in zip(fit.motions, observed.whole, strict=True)]
    visibility = sort_rays(observed.whole, poses, observed.views)
    colors = collect_colors(observed.views)
    arc_colors = None if colors is None else ArcColors.from_fit(fit, colors)
    evidence = JoinEvidence(float(fit.radii[0]), config.linking, visibility, observed.prior, arc_colors)
    return evidence, visibility


def _build_answer(
    ropes: _Ropes, radii: Radii, visibility: Visibility, observed: Observed, config: Config, run: Run
) -> Found:
    """Make chains of fitted ropes, with joins, doubts and warnings."""
    fit, parts, closed = ropes.fit, ropes.parts, ropes.closed
    if radii.held:
        radii_sd = radii.sd[ropes.nodes.classes]
    else:
        radii_sd = radii.cap(add_noise_deviation(fit.radii, fit.radii_sd, fit.sigma))[fit.radius_classes]
    unseen = measure_unseen(fit, parts, closed, visibility)
    whole = extend_hidden_ends(fit, parts, unseen)
    # joins refer to chains by their numbers, longest first
    chains = sorted(make_chains(fit, whole, closed, radii_sd, config), key=lambda chain: -chain.length)
    if not chains:
        raise NotEnoughDataError("views: the points make no rope; is the radius right, in metres?")
    joins = list_joins(ropes.by_class, chains)
    doubts = find_tube_doubts(ropes.by_class, joins, parts, fit, unseen)
    run.warnings.extend(warn_about_fit(fit, ropes.noise, radii, observed.numbers, config))
    run.warnings.extend(warn_about_answer(chains, doubts, visibility, observed.bounds, config.linking))
    return Found(
        chains,
        poses=[motion @ view.pose for motion, view in zip(fit.motions, observed.views, strict=True)],
        pose_sd=list(fit.pose_sd),
        stages={},
        joins=joins,
        doubts=doubts,
        alternatives=list_alternatives(ropes.by_class),
        sensor=ropes.noise.sensor,
        ends=tuple(ropes.ends),
        branch="tubes",
        all_rings=config.linking.rings == "always",
    )


def _thin_views(observed: Observed, steps: Sequence[int], together: int = 1) -> Observed:
    """Return the same with every n-th group of each view's points; single ones are those of `Clouds.thin`."""
    views = tuple(
        view.select(np.arange(len(view.points)) // together % step == 0)
        for view, step in zip(observed.views, steps, strict=True)
    )
    return replace(observed, views=views)
