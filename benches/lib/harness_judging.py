"""Judge graphs of harnesses by the truth, scene by scene, and print tables by group."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

import strand
from lib.judging import SURE, USEFUL
from lib.measure import compute_frechet, resampled
from lib.tables import print_head, print_row
from strand.ropes.harness import Harness
from strand.synthetic import HARNESSES, Camera, HarnessScene, Noise, Segmentation, harness

REACH = 3.0  # radii: of a found node from its true one, and of edges (Fréchet)
VIEWS = (1, 3, 7)
NOISE = (0.0003, 0.001)  # metres: range of plain noise
STEREO = 6  # each scene of this number and its multiples has imitated stereo and masks
KINDS = (
    "tree",
    "tree",
    "four",
    "equal",
    "tang",
    "cross",
    "near",
    "cycle",
    "tied",
    "loop",
    "air",
    "rope",
    "laid",
)
"""Kinds in the order in which a set takes turns; one in six is a rope or has an end laid on one."""

GIVEN = ("radii", "wire", "nothing")
"""Hints that a bench gives: the radii that occur and that of a wire, that of a wire alone, or neither."""

Answer = Callable[[HarnessScene, "list[float] | None", "float | None"], "tuple[Harness, float]"]
"""Takes a scene, the radii that occur and that of a wire, or None; returns the graph and its confidence."""


@dataclass(frozen=True)
class Judged:
    """A graph beside the truth.

    Attributes
    ----------
    scene, kind, noise : str
        Name, kind of harness, and "plain" or "stereo".
    views : int
        Number of images.
    right : bool
        Nodes and edges are those of the truth, each within reach, and no others.
    true_junctions, found_junctions, both : int
        Junctions of the truth, of the answer, and of both.
    at_crossings : int
        Found junctions that are none, at a crossing.
    true_edges, edges : int
        Edges of the truth, and those that the answer has within reach.
    lengths, radii : tuple of float
        Relative errors of the edges that are right.
    total : float
        Relative error of the length of all edges together.
    wires : tuple of bool
        Whether the number of wires is right, for each edge that has one in truth and answer.
    confidence, seconds : float
        Of the answer; of processor time.
    error : str
        The reason for no answer; empty if there is one.
    """

    scene: str
    kind: str
    noise: str
    views: int
    right: bool
    true_junctions: int
    found_junctions: int
    both: int
    at_crossings: int
    true_edges: int
    edges: int
    lengths: tuple[float, ...]
    radii: tuple[float, ...]
    total: float
    wires: tuple[bool, ...]
    confidence: float
    seconds: float
    error: str = ""

    @property
    def is_rope(self) -> bool:
        """Whether the truth has no junction, or an end that looks like one."""
        return self.kind in ("rope", "laid")


def draw_set(first: int, count: int, kinds: Sequence[str] = KINDS) -> Iterator[HarnessScene]:
    """Yield scenes of the kinds in turn, from seeds: 1, 3 or 7 views, plain noise or imitated stereo."""
    for number in range(first, first + count):
        rng = np.random.default_rng([36, number])
        kind, views = kinds[number % len(kinds)], int(rng.choice(VIEWS))
        if number % STEREO:
            noise = Noise(depth=float(rng.uniform(*NOISE)))
            yield harness(kind, seed=number, views=views, noise=noise)
            continue
        camera = Camera("sgbm", size=(1280, 720))
        # edges are fattened, ragged and a pixel off
        mask = Segmentation(grow=1, ragged=0.5)
        yield harness(kind, seed=number, views=min(views, VIEWS[1]), camera=camera, mask=mask)


def reconstruct_harness(
    scene: HarnessScene, radii: list[float] | None, wire: float | None
) -> tuple[Harness, float]:
    """Return the graph that `strand.reconstruct` finds in a scene, and the confidence."""
    model = strand.reconstruct(scene.views, radii, scene.bounds, branches=True, wire=wire)
    assert model.harness is not None
    return model.harness, model.confidence


def judge_harness(scene: HarnessScene, answer: Answer, given: str) -> tuple[Judged, Harness | None]:
    """Ask for the graph of a scene and compare it with the truth. Return it too."""
    radii = sorted({round(radius, 5) for radius in scene.radii}) if given == "radii" else None
    of_wires = [
        radius / math.sqrt(wires) for radius, wires in zip(scene.radii, scene.wires, strict=True) if wires
    ]
    wire = round(float(np.median(of_wires)), 5) if of_wires and given != "nothing" else None
    _ = scene.views
    begun, found, confidence, error = time.process_time(), None, 0.0, ""
    try:
        found, confidence = answer(scene, radii, wire)
    except strand.StrandError as raised:
        error = str(raised)
    seconds = time.process_time() - begun
    places = np.array([node.position for node in found.nodes]) if found else np.empty((0, 3))
    edges = [(edge.start, edge.stop) for edge in found.edges] if found else []
    lines = [edge.chain.points for edge in found.edges] if found else []
    thick = np.zeros(len(scene.nodes))
    for ends, radius in zip(scene.edges, scene.radii, strict=True):
        thick[list(ends)] = np.maximum(thick[list(ends)], radius)
    names = match_nodes(scene, thick, places, edges)
    pairs = match_edges(scene, names, edges, lines)
    true_degrees, degrees = (
        count_degrees(one, size) for one, size in ((scene.edges, len(scene.nodes)), (edges, len(places)))
    )
    junctions, true_junctions = np.flatnonzero(degrees > 1), np.flatnonzero(true_degrees > 1)
    both = sum(true in names and degrees[names[true]] > 1 for true in true_junctions.tolist())
    false = [
        number
        for number in junctions.tolist()
        if number not in [names.get(true) for true in true_junctions.tolist()]
    ]
    at_crossings = 0
    if false and len(scene.crossings):
        at_crossings = int((cdist(places[false], scene.crossings).min(axis=1) < 4.0 * thick.max()).sum())
    measured = [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in lines]
    true_lengths = [float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum()) for line in scene.truth]
    judged = Judged(
        scene=scene.name,
        kind=scene.kind,
        noise="plain" if scene.mask is None else "stereo",
        views=len(scene.depth),
        right=len(pairs) == len(scene.edges) == len(edges) and len(names) == len(scene.nodes) == len(places),
        true_junctions=len(true_junctions),
        found_junctions=len(junctions),
        both=both,
        at_crossings=at_crossings,
        true_edges=len(scene.edges),
        edges=len(pairs),
        lengths=tuple(abs(measured[j] / true_lengths[i] - 1.0) for i, j in pairs),
        radii=tuple(
            abs(found.edges[j].radius / scene.radii[i] - 1.0)
            for i, j in pairs
            if found and scene.kind != "tied"
        ),
        total=abs(sum(measured) / sum(true_lengths) - 1.0) if lines else math.inf,
        wires=tuple(
            found.edges[j].wires == scene.wires[i]
            for i, j in pairs
            if found and scene.wires[i] is not None and found.edges[j].wires is not None
        ),
        confidence=confidence,
        seconds=seconds,
        error=error,
    )
    return judged, found


def count_degrees(edges: Sequence[tuple[int, int]], nodes: int) -> np.ndarray:
    """Return the number of edges at each node."""
    return np.bincount(np.array(edges, int).reshape(-1), minlength=nodes)


def match_nodes(
    scene: HarnessScene, thick: np.ndarray, places: np.ndarray, edges: Sequence[tuple[int, int]]
) -> dict[int, int]:
    """Return the found node of each true one that has one within reach; ends go with ends."""
    if not len(places):
        return {}
    gaps = cdist(scene.nodes, places) / (REACH * thick[:, None])
    true_ends = count_degrees(scene.edges, len(scene.nodes)) == 1
    ends = count_degrees(edges, len(places)) == 1
    costs = np.where(gaps < 1.0, gaps, 1e3) + 10.0 * (true_ends[:, None] != ends[None])
    rows, columns = linear_sum_assignment(costs)
    return {int(i): int(j) for i, j in zip(rows, columns, strict=True) if costs[i, j] < 1.0}


def match_edges(
    scene: HarnessScene, names: dict[int, int], edges: Sequence[tuple[int, int]], lines: Sequence[np.ndarray]
) -> list[tuple[int, int]]:
    """Return pairs of a true edge and a found one between the same nodes, within reach of each other."""
    costs = np.full((len(scene.edges), len(edges)), 1e3)
    for i, ((start, stop), line, radius) in enumerate(
        zip(scene.edges, scene.truth, scene.radii, strict=True)
    ):
        for j, ends in enumerate(edges):
            for way, found in ((ends, lines[j]), (ends[::-1], lines[j][::-1])):
                if (names.get(start), names.get(stop)) == way:
                    far = compute_frechet(resampled(line), resampled(found)) / (REACH * radius)
                    costs[i, j] = min(costs[i, j], far if far <= 1.0 else 1e3)
    rows, columns = linear_sum_assignment(costs)
    return [(int(i), int(j)) for i, j in zip(rows, columns, strict=True) if costs[i, j] <= 1.0]


def print_summary(results: Sequence[Judged]) -> None:
    """Print tables: by kind, views and noise, and what the confidence is worth."""
    print_head(
        *("scenes", "number", "graphs right", "junctions found", "of true", "right", "at crossings"),
        *("edges right", "length error %", "of all %", "radius error %", "wires right", "CPU s", "slowest"),
    )
    groups: list[tuple[str, list[Judged]]] = [
        (kind, [one for one in results if one.kind == kind]) for kind in HARNESSES
    ]
    groups += [(f"{views} views", [one for one in results if one.views == views]) for views in VIEWS]
    groups += [(noise, [one for one in results if one.noise == noise]) for noise in ("plain", "stereo")]
    groups += [
        ("graphs", [one for one in results if not one.is_rope]),
        ("ropes", [one for one in results if one.is_rope]),
        ("all", list(results)),
    ]
    for name, group in groups:
        if not group:
            continue
        wires = [each for one in group for each in one.wires]
        print_row(
            name,
            len(group),
            sum(one.right for one in group),
            sum(one.found_junctions for one in group),
            sum(one.true_junctions for one in group),
            sum(one.both for one in group),
            sum(one.at_crossings for one in group),
            f"{sum(one.edges for one in group)} of {sum(one.true_edges for one in group)}",
            format_median([each for one in group for each in one.lengths]),
            format_median([one.total for one in group if one.right]),
            format_median([each for one in group for each in one.radii]),
            f"{sum(wires)} of {len(wires)}",
            f"{statistics.mean(one.seconds for one in group):.2f}",
            f"{max(one.seconds for one in group):.2f}",
        )
    print()
    sure = [one for one in results if one.confidence >= SURE]
    print_head(
        "scenes from", f"confidence {SURE} or more, wrong", "right", f"{USEFUL} or more, right", "all right"
    )
    print_row(
        results[0].scene,
        sum(not one.right for one in sure),
        sum(one.right for one in sure),
        sum(one.confidence >= USEFUL and one.right for one in results),
        sum(one.right for one in results),
    )


def format_median(values: Sequence[float]) -> str:
    """Return the median in percent."""
    return f"{100 * statistics.median(values):.2f}" if values else "–"
