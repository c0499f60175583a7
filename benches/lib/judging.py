"""Judge reconstructions by the truth, scene by scene, and print tables by group."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import strand
from lib import pictures
from lib.measure import Crossings, measure_chains
from lib.tables import format_head, format_row, print_head, print_row
from strand.synthetic import SyntheticScene, scene

SURE = 0.9  # confidence from which on an answer is sure
USEFUL = 0.8  # confidence from which on an answer is useful
MAX_NEAR = 3.0  # radii: greatest Fréchet distance of a chain near its rope


@dataclass(frozen=True)
class Judgement:
    """A reconstruction beside the truth.

    Attributes
    ----------
    scene : str
        The scene's name.
    views, ropes : int
        Number of images and of ropes.
    found : int
        Number of chains.
    right, near : bool
        As many chains as ropes, and each within 1.5 radii of its rope (3 radii) from end to end, in order.
    frechet, rms : float
        As in `lib.measure.Measure`: radii and metres.
    crossings : Crossings
    confidence : float
        0 where there is no answer.
    radius_error : float
        Greatest error of a chain's radius, over the true radius; infinite without chains.
    seconds : float
        From depth images to the model.
    error : str
        The reason for no answer; empty if there is an answer.
    """

    scene: str
    views: int
    ropes: int
    found: int
    right: bool
    near: bool
    frechet: float
    rms: float
    crossings: Crossings
    confidence: float
    radius_error: float
    seconds: float
    error: str = ""

    @property
    def sure_and_wrong(self) -> bool:
        """Whether the confidence is high and the topology wrong."""
        return self.confidence >= SURE and not self.right


def judge_scene(
    synthetic: SyntheticScene, *, give_radius: bool, give_ropes: bool, bare: bool = False
) -> tuple[Judgement, list[np.ndarray]]:
    """Reconstruct a scene, or its bare points, and judge it by the truth. Return the chains' nodes too."""
    views = synthetic.views
    if bare:
        views = tuple(strand.View(view.points, view.pose) for view in views)
    start = time.perf_counter()
    chains: list[np.ndarray] = []
    confidence, radius_error, error = 0.0, math.inf, ""
    try:
        model = strand.reconstruct(
            views,
            synthetic.radius if give_radius else None,
            synthetic.bounds,
            ropes=len(synthetic.truth) if give_ropes else None,
        )
    except strand.StrandError as raised:
        error = str(raised)
    else:
        chains, confidence = [chain.points for chain in model.chains], model.confidence
        if chains:
            radius_error = max(abs(chain.radius / synthetic.radius - 1.0) for chain in model.chains)
    seconds = time.perf_counter() - start
    # crossings as seen across the ropes' layer: along z on a table, not before a wall
    turn = 2 - int(np.argmin(np.ptp(np.concatenate(synthetic.truth), axis=0)))
    truth, answer = ([np.roll(nodes, turn, axis=1) for nodes in lines] for lines in (synthetic.truth, chains))
    found = measure_chains(answer, truth, synthetic.radius)
    # a scene without chains has crossings too
    crossings = found.crossings if chains else measure_chains(truth, truth, 1.0).crossings
    return (
        Judgement(
            scene=synthetic.name,
            views=len(synthetic.depth),
            ropes=found.ropes,
            found=found.chains,
            right=found.right,
            near=found.chains == found.ropes and found.frechet <= MAX_NEAR,
            frechet=found.frechet,
            rms=found.rms,
            crossings=crossings if chains else Crossings(0, crossings.true, 0),
            confidence=confidence,
            radius_error=radius_error,
            seconds=seconds,
            error=error,
        ),
        chains,
    )


def judge_scenes(
    scenes: Iterable[SyntheticScene],
    folder: Path | None,
    *,
    give_radius: bool = True,
    give_ropes: bool = True,
    bare: bool = False,
) -> list[Judgement]:
    """Judge scenes, print a row for each, and draw those that are not right into a folder."""
    # loads modules and starts threads, so that the first scene does not
    warm = scene("straight", views=1)
    strand.reconstruct(warm.views, warm.radius, warm.bounds)
    print_head("scene", "topology", "chains", "Fréchet / r", "RMS mm", "crossings", "confidence", "ms")
    results = []
    for synthetic in scenes:
        found, chains = judge_scene(synthetic, give_radius=give_radius, give_ropes=give_ropes, bare=bare)
        results.append(found)
        print_row(
            found.scene,
            "right" if found.right else "near" if found.near else "wrong",
            f"{found.found} of {found.ropes}",
            f"{found.frechet:.2f}",
            f"{found.rms * 1e3:.2f}",
            f"{found.crossings.right} of {found.crossings.true}",
            f"{found.confidence:.2f}",
            f"{found.seconds * 1e3:.0f}",
        )
        if folder is not None and not found.right:
            pictures.draw_scene(synthetic, chains, folder / f"{found.scene}.png")
    return results


def format_summary(
    results: Sequence[Judgement], what: str, groups: Sequence[tuple[str, Callable[[Judgement], bool]]]
) -> str:
    """Return a table with a row for each group of scenes that has any, and one for all."""
    lines = [
        format_head(
            what,
            "scenes",
            "right",
            "within 3 r",
            "crossings",
            f"confidence ≥ {SURE} and wrong",
            f"right with confidence ≥ {USEFUL}",
            "RMS mm, median of the right",
            "radius error %, median",
            "ms, median",
            "max",
        )
    ]
    for name, belongs in [*groups, ("all", lambda _: True)]:
        group = [found for found in results if belongs(found)]
        if not group:
            continue
        milliseconds = [found.seconds * 1e3 for found in group]
        lines.append(
            format_row(
                name,
                len(group),
                sum(found.right for found in group),
                sum(found.near for found in group),
                "{} of {}".format(
                    *(sum(getattr(found.crossings, key) for found in group) for key in ("right", "true"))
                ),
                sum(found.sure_and_wrong for found in group),
                sum(found.right and found.confidence >= USEFUL for found in group),
                _format_median([found.rms * 1e3 for found in group if found.right], 2),
                _format_median([found.radius_error * 100 for found in group], 1),
                _format_median(milliseconds, 0),
                f"{max(milliseconds):.0f}",
            )
        )
    return "\n".join(lines)


def _format_median(values: Sequence[float], digits: int) -> str:
    """Return the median with a number of digits."""
    return f"{statistics.median(values):.{digits}f}" if values else "–"
