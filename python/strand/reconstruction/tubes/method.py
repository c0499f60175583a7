"""The default method, composed: register, trace arcs, decide how they join, fit whole ropes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strand._core import NotEnoughDataError
from strand.config import Config
from strand.reconstruction.evidence.answer_warnings import warn_about_answer
from strand.reconstruction.evidence.color import ArcColors, colors_of
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.visibility import visibility_from
from strand.reconstruction.radius import deviate_with_noise
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.tubes.arcs import fit_arcs, seen_arcs, with_unexplained
from strand.reconstruction.tubes.clouds import Clouds
from strand.reconstruction.tubes.decision import chosen, decided, decided_again
from strand.reconstruction.tubes.fit_warnings import warn_about_fit
from strand.reconstruction.tubes.joins import all_joins, alternatives
from strand.reconstruction.tubes.noise import expected_noise
from strand.reconstruction.tubes.pixels import Cameras
from strand.reconstruction.tubes.registration import registered_roughly
from strand.reconstruction.tubes.second_look import to_decide_again
from strand.reconstruction.tubes.tube_doubts import doubts
from strand.reconstruction.tubes.tube_ends import with_hidden_ends
from strand.reconstruction.tubes.tube_nodes import as_chains
from strand.reconstruction.tubes.whole_ropes import fit_ropes, rope_parts

# what a deadline may leave out
SECOND_LOOK = "a second look at what is not explained"
# how often what the last fit leaves unexplained reopens the decision
_REOPENED = 1


def find_chains(observed: Observed, config: Config, run: Run) -> Found:
    """Trace, register, fit and link on filtered views that all see something.

    Parameters
    ----------
    observed : Observed
        If its prior knows how many ropes there are, gaps are bridged until no more are left; if it knows
        their lengths, bridges are as long as these leave.
    config : Config
    run : Run

    Returns
    -------
    Found
        Its stages are "registered" (points at the corrected poses), "arcs" (what was seen of the ropes
        before they were linked) and "fit" (the last `TubeFit`).

    Raises
    ------
    strand.NotEnoughDataError
        If there is nothing like a tube of this radius in the points.
    """
    try:
        return _find(observed, config, run)
    except NotEnoughDataError:
        if not observed.radii.free:
            raise
        # strands that lie side by side all along look like thicker ones
        return _find(replace(observed, radii=observed.radii.add_parts()), config, run)


def _find(observed: Observed, config: Config, run: Run) -> Found:
    radii, prior = observed.radii, observed.prior
    clouds = Clouds.of(observed.views, observed.bounds, observed.held)
    cameras = Cameras(observed.views, observed.whole)
    given = None
    if config.sensor is not None:
        given = expected_noise(config.sensor, cameras, float(radii.values.min()), config.tubes.spacing)
        config = replace(config, sensor=None, tubes=replace(config.tubes, noise=given.sd))
    with run.stage("register"):
        few = clouds.thinned(float(radii.values.min()))
        motions = registered_roughly(few, radii.values, config)
    if run.skips("most of the points"):
        observed = _thinned(observed, clouds.step(float(radii.values.min())))
        clouds, cameras = few, Cameras(observed.views, observed.whole)
    with run.stage("arcs"):
        fit, radii = fit_arcs(clouds, few, motions, radii, config, run)
        before = fit if run.skips(SECOND_LOOK) else with_unexplained(clouds, fit, config)
        arcs = seen_arcs(before, config)
    with run.stage("link"):
        poses = [motion @ view.pose for motion, view in zip(before.motions, observed.whole, strict=True)]
        visibility = visibility_from(observed.whole, poses, observed.views)
        colors = colors_of(observed.views)
        arc_colors = None if colors is None else ArcColors.of(before, colors)
        evidence = JoinEvidence(float(before.radii[0]), config.linking, visibility, prior, arc_colors)
        by_class = decided(clouds, arcs, before, evidence, config, run)
    for reopenings in range(1 + _REOPENED):
        ropes, closed = chosen(by_class)
        with run.stage("fit"):
            fit, noise, ends = fit_ropes(clouds, cameras, ropes, closed, before, radii, given, config, run)
        with run.stage("ends"):
            parts = rope_parts(fit, ropes, closed, before, prior, config)
            # no decision is reopened that no fit would follow
            other_arcs = None
            if reopenings < _REOPENED and not run.skips(SECOND_LOOK):
                as_before = fit.replace(
                    radius_classes=np.array(ropes.classes),
                    radii=before.radii,
                    radii_sd=before.radii_sd,
                    bands=before.bands,
                )
                other_arcs = to_decide_again(as_before, parts, visibility)
        if other_arcs is None:
            break
        with run.stage("link"):
            again = decided_again(by_class, other_arcs, clouds, before, evidence, config, run)
        if again is None:
            break
        by_class = again
    if radii.held:
        radii_sd = radii.sd[ropes.classes]
    else:
        radii_sd = radii.cap(deviate_with_noise(fit.radii, fit.radii_sd, fit.sigma))[fit.radius_classes]
    whole = with_hidden_ends(fit, parts, closed, visibility)
    # joins name chains by their numbers, longest first
    chains = sorted(as_chains(fit, whole, closed, radii_sd, config), key=lambda chain: -chain.length)
    if not chains:
        raise NotEnoughDataError("views: the points make no rope; is the radius right, in metres?")
    joins = all_joins(by_class, chains, config.linking)
    open_parts = [None if ring else part for part, ring in zip(parts, closed, strict=True)]
    uncertain = doubts(by_class, joins, open_parts, fit, visibility)
    run.warnings.extend(warn_about_fit(fit, noise, radii, observed.numbers, config))
    run.warnings.extend(warn_about_answer(chains, uncertain, visibility, observed.bounds, config.linking))
    starts = np.cumsum([len(cloud) for cloud in clouds.points])[:-1]
    return Found(
        chains,
        poses=[motion @ view.pose for motion, view in zip(fit.motions, observed.views, strict=True)],
        pose_sd=list(fit.pose_sd),
        stages={"registered": tuple(np.split(fit.points, starts)), "arcs": tuple(arcs.nodes), "fit": fit},
        branch="tubes",
        joins=joins,
        doubts=uncertain,
        alternatives=alternatives(by_class),
        sensor=noise.sensor,
        ends=tuple(ends),
        all_rings=config.linking.rings == "always",
    )


def _thinned(observed: Observed, step: int) -> Observed:
    """Return the same with every n-th point of each view, as `Clouds.every` takes them."""
    views = tuple(view.only(np.arange(len(view.points)) % step == 0) for view in observed.views)
    return replace(observed, views=views)
