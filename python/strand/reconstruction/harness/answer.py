"""Answer with a harness: its graph, its doubts, its confidence, and the model that holds them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from strand.reconstruction.answering import (
    collect_poses,
    collect_stages,
    describe_chains,
    doubt_haste,
    list_images,
)
from strand.reconstruction.finding.table_edge import doubt_ends_at_edge
from strand.reconstruction.harness.certainty import Certainty, judge
from strand.reconstruction.harness.flat_bundles import FlatBundles
from strand.reconstruction.harness.graph import Graph, make_graph, make_harness
from strand.reconstruction.harness.left_pieces import doubt_left_pieces
from strand.reconstruction.harness.look_doubts import (
    doubt_by_rival,
    doubt_dropped,
    doubt_grazing_views,
    is_same_graph,
)
from strand.reconstruction.harness.method import FoundHarness, find_harnesses
from strand.reconstruction.harness.net_evidence import doubt_differences
from strand.reconstruction.harness.wires import Choice, choose_radii, list_bundles
from strand.reconstruction.images.border_ends import doubt_ends_at_border
from strand.reconstruction.observing import Hints, Scene
from strand.reconstruction.stages import Found, Run
from strand.reconstruction.upwards import find_up
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.ropes.model import Model
from strand.support.checks import Array

_SAME_PLACE = 6.0  # distance of nodes of two looks that are one at most, radii
_SURE = (0.8, 0.9)  # confidence of one look and of two above which no other is taken
_NO_BUNDLES = 0.1  # doubt of strands that are no bundles of the given wire
_FLAT = 0.06  # doubt of a harness with wires that lie side by side
_FLAT_SD = 0.05  # radii: deviation of those of wires side by side, which their width counts
_OTHER_WIRE = 0.1  # radii: difference of a wire's radius from that by the height of wires side by side
_UNEQUAL = 0.1  # doubt of a junction at which wires do not add up
_MIN_WARNED = 0.1  # lesser doubts have no warning


def answer_with_harness(scene: Scene, hints: Hints, run: Run, keep_stages: bool) -> Model:
    """Find a harness in a scene, and build its model.

    Parameters
    ----------
    scene : Scene
    hints : Hints
    run : Run
    keep_stages : bool
        Whether the model keeps the arrays between the stages.

    Raises
    ------
    strand.NotEnoughDataError
        If the views show no ropes.
    """
    look = _find_surest(scene, hints, run)
    harness, found, poses, chains = look.harness, look.found, look.poses, look.chains
    graph, certainty = look.graph, look.certainty
    upwards = find_up(scene, found, found.chains, hints.previous)
    wires, wire_doubts = _count_wires(harness, graph, hints.wire)
    whole, tables = scene.extract.whole, scene.tables
    if not tables:
        whole, tables = tuple(scene.observed.whole), tuple(harness.ground.tables)
    at_edge = doubt_ends_at_edge(chains, whole, tables)
    at_border = doubt_ends_at_border(chains, list_images(scene, list(poses)))
    cut = [doubt for doubt, _ in (*at_edge, *at_border)]
    answer = make_harness(graph, chains, certainty.nodes, wires)
    differences = [] if hints.net is None else doubt_differences(hints.net, answer)
    own = [
        *certainty.doubts,
        *wire_doubts,
        *_doubt_flat(harness.beside.flat),
        *differences,
        *upwards.doubts,
        *cut,
    ]
    for doubt in own:
        if doubt.amount >= _MIN_WARNED:
            run.warn(doubt.kind, str(doubt), doubt.place, doubt.amount)
    doubts = sorted([*own, *scene.mask_doubts, *doubt_haste(run)], key=lambda doubt: -doubt.amount)
    return Model(
        tuple(chains),
        poses,
        run.timings,
        tuple(run.warnings),
        collect_stages(scene, found) if keep_stages else {},
        look.pose_sd,
        confidence=certainty.weigh(doubts),
        doubts=tuple(doubts),
        method=hints.config.method,
        up=upwards.up,
        table=upwards.table,
        stamp=max((view.stamp for view in scene.extract.whole if view.stamp is not None), default=None),
        harness=answer,
    )


@dataclass(frozen=True, eq=False)
class _Look:
    """A harness as it looks from one side, and how sure that is."""

    harness: FoundHarness
    found: Found
    poses: Array
    pose_sd: Array
    chains: list[Chain]
    graph: Graph
    certainty: Certainty

    @property
    def confidence(self) -> float:
        return self.certainty.weigh(self.certainty.doubts)


def _find_surest(scene: Scene, hints: Hints, run: Run) -> _Look:
    """Return the surest look at a harness; the first that is sure ends the search."""
    looks: list[_Look] = []
    for harness in find_harnesses(scene.observed, hints.config, run, hints.wire, hints.net):
        found = _collect(harness, scene)
        poses, pose_sd = collect_poses(scene, found)
        chains = describe_chains(found.chains, scene.extract.whole, list(poses))
        graph = make_graph(chains, harness.strands, harness.fitted.places, harness.fitted.covariances)
        certainty = judge(harness, graph, chains)
        pieces = list(doubt_left_pieces(harness, graph, chains))
        certainty = replace(certainty, doubts=[*certainty.doubts, *pieces])
        looks.append(_Look(harness, found, poses, pose_sd, chains, graph, certainty))
        # one view may be sure where a strand hides another
        sure = looks[-1].confidence >= _SURE[min(len(looks), 2) - 1]
        if (sure and (len(looks) > 1 or len(scene.observed.views) > 1)) or (harness.traced and not pieces):
            break
    best, *others = sorted(looks, key=lambda look: -look.confidence)
    reach = _SAME_PLACE * max(chain.radius for chain in best.chains)
    rivals = [other.confidence for other in others if not is_same_graph(best.graph, other.graph, reach)]
    doubts = [
        *(doubt_by_rival(best.confidence, rival) for rival in rivals),
        *doubt_grazing_views(best.harness.ground),
        *doubt_dropped(scene.observed, best.harness.ground, best.chains),
    ]
    certainty = replace(best.certainty, doubts=[*best.certainty.doubts, *doubts])
    return replace(best, certainty=certainty)


def _doubt_flat(flat: NDArray[np.bool_]) -> list[Doubt]:
    """Doubt a harness with strands in which wires lie side by side."""
    if not flat.any():
        return []
    reason = "wires lie side by side: no width tells where they part, or whether they are several ropes"
    return [Doubt("rival", _FLAT, "where strands meet", reason)]


def _count_wires(
    harness: FoundHarness, graph: Graph, wire: float | None
) -> tuple[list[int | None], list[Doubt]]:
    """Return the wires of each strand, and doubts where they do not add up."""
    if wire is None:
        return [None] * len(graph.pairs), []
    side_by_side = wire * np.sqrt(harness.beside.wires)
    radii = np.where(harness.beside.flat, side_by_side, harness.fitted.widths)
    deviations = np.where(harness.beside.flat, _FLAT_SD, harness.fitted.deviations)
    choice = choose_radii(radii, graph.pairs, list_bundles(wire), deviations)
    if choice.counts[0] is None:
        reason = (
            f"strands with radii of {radii.min() * 1e3:.1f} to {radii.max() * 1e3:.1f} mm are no bundles of"
        )
        return choice.counts, [
            Doubt("wires", _NO_BUNDLES, "how many wires there are", f"{reason} wires of {wire * 1e3:.3g} mm")
        ]
    reason = "the wires of the thickest strand are not the sum of the others' wires"
    at_nodes = [
        Doubt("wires", _UNEQUAL, "how many wires meet", reason, graph.places[node]) for node in choice.unequal
    ]
    return choice.counts, [*_doubt_counts(choice, radii, harness.beside, wire), *at_nodes]


def _doubt_counts(choice: Choice, radii: Array, beside: FlatBundles, wire: float) -> Iterator[Doubt]:
    """Doubt numbers of wires where another wire, or other numbers, explain the radii (K,) of strands."""
    what = "how many wires there are"
    thick = float(np.median(beside.lying[beside.flat])) if beside.flat.any() else wire
    if np.isfinite(thick) and abs(thick / wire - 1.0) > _OTHER_WIRE:
        reason = f"wires side by side are {2e3 * thick:.1f} mm high, not {2e3 * wire:.1f} mm"
        yield Doubt("wires", _NO_BUNDLES, what, reason)
    if choice.strained:
        off = radii / list_bundles(wire)[choice.numbers] - 1.0
        worst = int(np.abs(off).argmax())
        side = "thicker" if off[worst] > 0.0 else "thinner"
        reason = (
            f"a strand is {100.0 * abs(off[worst]):.0f} % {side} than a bundle of {choice.counts[worst]} "
            f"wires with a radius of {wire * 1e3:.2f} mm"
        )
        yield Doubt("wires", _NO_BUNDLES, what, reason)
    other = 1.0 / (1.0 + math.exp(0.5 * min(choice.margin, 100.0)))
    if choice.rival is not None and other > _MIN_WARNED:
        counts = ", ".join(str(number + 1) for number in choice.rival)
        yield Doubt("wires", other, what, f"edges with {counts} wires fit nearly as well")


def _collect(harness: FoundHarness, scene: Scene) -> Found:
    """Return the parts of an answer that all methods have."""
    fit, views = harness.fitted.fit, scene.observed.views
    starts = np.cumsum(harness.fitted.sizes)[:-1]
    return Found(
        harness.fitted.chains,
        poses=[motion @ view.pose for motion, view in zip(fit.motions, views, strict=True)],
        pose_sd=list(fit.pose_sd),
        stages={
            "registered": tuple(np.split(fit.points, starts)),
            "arcs": tuple(strand.nodes for strand in harness.strands),
            "fit": fit,
        },
    )
