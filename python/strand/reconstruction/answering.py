"""Answer: orient the chains, add the doubts that the input raises, and build the model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from strand.reconstruction.appearance import find_color, find_label
from strand.reconstruction.evidence.confidence import assign_doubts, find_contradictions
from strand.reconstruction.evidence.hidden_ends import doubt_hidden_ends, drop_explained, find_hidden_ends
from strand.reconstruction.evidence.measured import (
    Circumstances,
    Shape,
    describe_shapes,
    measure_bound,
    measure_evidence,
)
from strand.reconstruction.finding.ends_at_things import doubt_ends_at_things
from strand.reconstruction.finding.table_edge import doubt_ends_at_edge
from strand.reconstruction.images.border_ends import doubt_ends_at_border
from strand.reconstruction.observing import Hints, Scene
from strand.reconstruction.orientation import oriented
from strand.reconstruction.stages import Found, Run
from strand.reconstruction.upwards import find_up
from strand.ropes.chain import Chain, remarked
from strand.ropes.doubt import Doubt, rated
from strand.ropes.model import Model
from strand.ropes.posterior import load_posterior
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View, placed

_HASTE_DOUBT = 0.6  # doubt of an answer for which the deadline made strand skip something


def build_model(scene: Scene, found: Found, hints: Hints, run: Run, keep_stages: bool) -> Model:
    """Build the model of the chains that a method found.

    Parameters
    ----------
    scene : Scene
    found : Found
        The method's answer for the observed views.
    hints : Hints
    run : Run
    keep_stages : bool
        Whether the model keeps the arrays between the stages.
    """
    poses, pose_sd = collect_poses(scene, found)
    stages = collect_stages(scene, found) if keep_stages else {}
    earlier = () if hints.previous is None else hints.previous.chains
    chains = oriented(found.chains[: hints.prior.ropes], earlier)
    upwards = find_up(scene, found, chains, hints.previous)
    against = find_contradictions(chains, found.chains[len(chains) :], hints.prior, found.all_rings)
    if scene.tables:
        against += doubt_ends_at_edge(chains, scene.extract.whole, scene.tables)
    against += doubt_ends_at_things(chains, scene.observed.whole, bool(scene.tables))
    chains = describe_chains(chains, scene.extract.whole, list(poses))
    against += doubt_hidden_ends(chains)
    run.warnings[:] = drop_explained(run.warnings, chains)
    for doubt, about in [*against, *((doubt, ()) for doubt in upwards.doubts)]:
        run.warn(doubt.kind, doubt.reason, doubt.place, doubt.amount, about)
    at_border = doubt_ends_at_border(chains, list_images(scene, list(poses)))
    for doubt, (number,) in at_border:
        run.warn("cut end", f"chain {number}: {doubt.reason}", doubt.place, doubt.amount, (number,))
    against += at_border
    doubts = sorted(
        [
            *drop_explained(found.doubts or (), chains),
            *(doubt for doubt, _ in against),
            *scene.mask_doubts,
            *upwards.doubts,
            *doubt_haste(run),
        ],
        key=lambda doubt: -doubt.amount,
    )
    confidence, alternatives = float("nan"), found.alternatives
    if found.doubts is not None:
        how = _describe_circumstances(scene, found, hints, run)
        shapes = describe_shapes(chains)
        evidence = measure_evidence(doubts, shapes, how)
        costs = [other.cost for other in alternatives]
        confidence, *others = (
            load_posterior("answers").compute(evidence, measure_bound(doubts), costs).tolist()
        )
        alternatives = tuple(rated(other, said) for other, said in zip(alternatives, others, strict=True))
        chains = _add_confidence(chains, shapes, assign_doubts(chains, doubts, against), how)
    return Model(
        tuple(chains),
        poses,
        run.timings,
        tuple(run.warnings),
        stages,
        pose_sd,
        confidence=confidence,
        joins=tuple(join for join in found.joins if max(join.chains) < len(chains)),
        doubts=tuple(doubts),
        alternatives=alternatives,
        method=hints.config.method,
        branch=found.branch,
        sensor=found.sensor,
        up=upwards.up,
        table=upwards.table,
        stamp=max((view.stamp for view in scene.extract.whole if view.stamp is not None), default=None),
    )


def describe_chains(chains: Sequence[Chain], views: Sequence[View], poses: Sequence[Array]) -> list[Chain]:
    """Return chains with their labels, colours and hidden ends, as views with these poses show them."""
    hidden = find_hidden_ends(chains, views, poses)
    views = [placed(view, pose) for view, pose in zip(views, poses, strict=True)]
    return [
        remarked(chain, label=find_label(chain, views), color=find_color(chain, views), hidden_ends=ends)
        for chain, ends in zip(chains, hidden, strict=True)
    ]


def list_images(scene: Scene, poses: Sequence[Array]) -> list[DepthImage]:
    """Return the views' images with these poses; those made of clouds end where the clouds do."""
    images = [
        view.image.placed(pose)
        for view, pose in zip(scene.extract.whole, poses, strict=True)
        if view.image is not None
    ]
    for number, drawn in scene.observed.pictures.items():
        pose = poses[number] @ np.linalg.inv(scene.extract.whole[number].pose) @ drawn.pose
        rows, columns = (np.flatnonzero((drawn.depth > 0).any(axis=axis)) for axis in (1, 0))
        window = slice(int(rows[0]), int(rows[-1]) + 1), slice(int(columns[0]), int(columns[-1]) + 1)
        images.append(drawn.cropped(window).placed(pose))
    return images


def doubt_haste(run: Run) -> list[Doubt]:
    """Return the doubt that skipped work raises, and warn of it, if the deadline passed."""
    if not run.skipped:
        return []
    doubt = Doubt("deadline", _HASTE_DOUBT, "whether that is right", f"skipped: {', '.join(run.skipped)}")
    run.warn(doubt.kind, doubt.reason, amount=doubt.amount)
    return [doubt]


def _describe_circumstances(scene: Scene, found: Found, hints: Hints, run: Run) -> Circumstances:
    whole = scene.extract.whole
    return Circumstances(
        found.sensor,
        len(whole),
        has_images=any(view.image is not None for view in whole),
        has_masks=any(view.mask is not None for view in whole),
        has_things=any(warning.kind == "thing" for warning in run.warnings),
        from_images=found.branch == "images",
        knows_ropes=hints.prior.ropes is not None,
        knows_lengths=bool(hints.prior.lengths),
    )


def _add_confidence(
    chains: Sequence[Chain],
    shapes: Sequence[Shape],
    doubts: Sequence[tuple[Doubt, ...]],
    how: Circumstances,
) -> list[Chain]:
    """Return chains with the confidence and the doubts of each."""
    posterior = load_posterior("chains")
    sure = []
    for chain, shape, own in zip(chains, shapes, doubts, strict=True):
        evidence = measure_evidence(own, [shape], how)
        confidence = float(posterior.compute(evidence, measure_bound(own))[0])
        sure.append(remarked(chain, confidence=confidence, doubts=own))
    return sure


def collect_poses(scene: Scene, found: Found) -> tuple[np.ndarray, np.ndarray]:
    """Return poses of all views and their deviations: registered where a view was used, else as given."""
    poses = np.array([view.pose for view in scene.extract.whole])
    pose_sd = np.full((len(poses), 6), np.nan)
    numbers = scene.observed.numbers
    poses[numbers], pose_sd[numbers] = found.poses, found.pose_sd
    return poses, pose_sd


def collect_stages(scene: Scene, found: Found) -> dict[str, Any]:
    """Return the arrays between the stages, read-only."""
    stages = {
        "raw": tuple(scene.extract.inside[number].world_points for number in scene.observed.numbers),
        "filtered": tuple(view.world_points for view in scene.observed.views),
        **found.stages,
    }
    for kept in stages.values():
        for array in kept if isinstance(kept, tuple) else (kept,):
            if isinstance(array, np.ndarray):
                array.setflags(write=False)
    return stages
