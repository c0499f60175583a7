"""What a reconstruction did, in numbers and in lines of text."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand.ropes.chain import Chain
from strand.ropes.crossings import list_crossings
from strand.ropes.model import Model
from strand.views.view import View

# each method's stages, and what they hand on by its name in Model.stages: None for stages that hand on no
# points; the last one hands on the model's chains
STAGE_ARRAYS: dict[str, dict[str, str | None]] = {
    "tubes": {
        "extract": "raw",
        "radius": None,
        "filter": "filtered",
        "register": "registered",
        "arcs": "arcs",
        "link": None,
        "fit": None,
        "ends": "chains",
    },
    "images": {
        "extract": "raw",
        "radius": None,
        "filter": "filtered",
        "images": "registered",
        "readings": None,
        "explain": "readings",
        "fit images": "chains",
    },
    "published": {
        "extract": "raw",
        "filter": "filtered",
        "normals": "normals",
        "register": "registered",
        "centerline": "axis_points",
        "trace": "traced",
        "split": "segments",
        "reconnect": "chains",
    },
}
# what each method makes of the points on the way to whole ropes, by its name in Model.stages
COUNTED = {
    "tubes": {"arcs": "arcs seen", "chains": "whole ropes"},
    "images": {"readings": "ropes in the readings compared", "chains": "whole ropes"},
    "published": {
        "traced": "chains traced",
        "segments": "segments after the split",
        "chains": "whole strings",
    },
}
PAPER_COUNTS = (3, 7, 1)
# so many kinds of doubt a row names: a table fits in 80 columns
_KINDS = 2
# so many crossings a table has
_CROSSINGS = 30


@dataclass(frozen=True)
class StageCount:
    """Points into and out of one stage.

    Attributes
    ----------
    name : str
        The stage.
    points_in, points_out : int or None
        Points before and after it; arcs and chains count with all their nodes. None if it hands on no points:
        it estimates the radius, or works on curves.
    seconds : float
        The time it took.
    """

    name: str
    points_in: int | None
    points_out: int | None
    seconds: float


@dataclass(frozen=True)
class Accuracy:
    """How far a chain is from the true centreline.

    Attributes
    ----------
    length_error : float
        Difference of the lengths over the true length; positive where the chain is too long.
    rms : float
        Root mean square distance of the chain, resampled every 1 mm, from the centreline, metres.
    """

    length_error: float
    rms: float


def find_stage_names(model: Model) -> str:
    """Return whose stages a model holds, its branch or its method.

    Raises
    ------
    ValueError
        If the model was made without its stages.
    """
    name = model.branch or model.method
    if not model.stages or name not in STAGE_ARRAYS:
        raise ValueError("model: expected one with its stages, from reconstruct(..., keep_stages=True)")
    return name


def count_stages(views: Sequence[View], model: Model) -> tuple[StageCount, ...]:
    """Count the points through the stages.

    Parameters
    ----------
    views : sequence of View
        What the model was made from.
    model : Model
        Made with `keep_stages=True`.

    Returns
    -------
    tuple of StageCount
        In the stages' order; without those that did not run.

    Raises
    ------
    ValueError
        If the model was made without its stages.
    """
    arrays = _handed_on(model)
    counts = []
    before = sum(len(view.points) for view in views)
    for name, key in STAGE_ARRAYS[find_stage_names(model)].items():
        if name not in model.timings:
            continue
        if key is None:
            counts.append(StageCount(name, None, None, model.timings[name]))
            continue
        after = _points(arrays[key])
        counts.append(StageCount(name, before, after, model.timings[name]))
        before = after
    return tuple(counts)


def count_chains(model: Model) -> tuple[int, ...]:
    """Count what became whole ropes.

    Parameters
    ----------
    model : Model
        Made with `keep_stages=True`.

    Returns
    -------
    tuple of int
        The arcs seen and the whole ropes; by the published method the chains traced, the segments after the
        split, and the whole strings.

    Raises
    ------
    ValueError
        If the model was made without its stages.
    """
    arrays = _handed_on(model)
    return tuple(len(arrays[key]) for key in COUNTED[find_stage_names(model)])


def measure_accuracy(chain: Chain, truth: ArrayLike) -> Accuracy:
    """Compare a chain with the true centreline.

    Parameters
    ----------
    chain : Chain
        What was reconstructed.
    truth : (M, 3) array_like of float
        Nodes of the true centreline, world frame, metres, M >= 2.

    Returns
    -------
    Accuracy
        Its `rms` takes the nearest place of the centreline for each place of the chain, so it says
        nothing of parts that the chain leaves out: `length_error` does.

    Raises
    ------
    TypeError
        If `truth` does not hold floating point numbers.
    ValueError
        If `truth` is not a chain's nodes.
    """
    true = Chain(np.asarray(truth), chain.radius)
    places = np.linspace(0.0, chain.length, max(round(chain.length / 1e-3) + 1, 2))
    distances = true.nearest(chain.at(places)).distance
    rms = float(np.sqrt(np.mean(distances**2)))
    return Accuracy(chain.length / true.length - 1.0, rms)


def describe_stages(views: Sequence[View], model: Model) -> str:
    """Table of the stages: points in, points out, milliseconds."""
    rows = [
        (count.name, _shown(count.points_in), _shown(count.points_out), f"{count.seconds * 1e3:.1f}")
        for count in count_stages(views, model)
    ]
    return _table([("stage", "points in", "points out", "ms"), *rows, _total(model.timings, columns=4)])


def describe_counts(model: Model) -> str:
    """Table of the counts of `chain_counts`; by the published method with those of the paper beside them."""
    made_by = find_stage_names(model)
    names, counts = COUNTED[made_by].values(), map(str, count_chains(model))
    if made_by == "published":
        return _table([("", "here", "paper"), *zip(names, counts, map(str, PAPER_COUNTS), strict=True)])
    return _table([("", "here"), *zip(names, counts, strict=True)])


def describe_accuracy(model: Model, truth: Sequence[ArrayLike]) -> str:
    """One line for each rope: its length and its error against the true centreline.

    The longest chain is compared with the longest centreline, and so on; further ones are left out.
    """
    lines = []
    centrelines = sorted(truth, key=_length, reverse=True)
    for i, (chain, true) in enumerate(zip(model.chains, centrelines, strict=False)):
        error = measure_accuracy(chain, true)
        lines.append(
            f"rope {i}: length {chain.length * 1e3:.1f} mm, truth {_length(true) * 1e3:.1f} mm "
            f"({error.length_error:+.2%}), RMS distance from truth {error.rms * 1e3:.2f} mm"
        )
    return "\n".join(lines)


def describe_chains(model: Model) -> str:
    """Table of the chains: length, nodes, radius, open or closed; confidence and doubts, if it has them."""
    sure = any(not np.isnan(chain.confidence) for chain in model.chains)
    rows = [
        (
            f"{i}",
            f"{chain.length * 1e3:.1f}",
            f"{len(chain.points)}",
            f"{chain.radius * 1e3:.2f}",
            "closed" if chain.closed else "open",
            *((f"{chain.confidence:.2f}", _kinds(chain)) if sure else ()),
        )
        for i, chain in enumerate(model.chains)
    ]
    more = ("confidence", "doubts") if sure else ()
    return _table([("chain", "length / mm", "nodes", "radius / mm", "ends", *more), *rows], (0, 6))


def describe_crossings(model: Model) -> str:
    """Table of the crossings as seen from above: both strands, the clearance, how sure the order is.

    Empty without any.
    """
    met = list_crossings(model.chains, (0, 0, 1), model.doubts)
    rows = [
        (
            *(f"{chain} at {s * 1e3:.1f}" for chain, s in (one.over, one.under)),
            f"{one.gap * 1e3:.1f}",
            f"{np.degrees(one.angle):.0f}",
            f"{one.sign:+d}",
            f"{one.probability:.3f}",
        )
        for one in met[:_CROSSINGS]
    ]
    if not rows:
        return ""
    head = ("over: chain at mm", "under", "gap / mm", "angle / °", "sign", "probability")
    more = f"\nand {len(met) - _CROSSINGS} more crossings" if len(met) > _CROSSINGS else ""
    return _table([head, *rows]) + more


def describe_confidence(model: Model) -> str:
    """One line: how sure all ropes together are."""
    if np.isnan(model.confidence):
        return "confidence: not known, as the method does not say"
    return f"confidence: {model.confidence:.2f} that all ropes run as said"


def describe_frame(model: Model) -> str:
    """One line of a recording's frame: how long its ropes are, and how sure that is."""
    lengths = ", ".join(f"{chain.length * 1e3:.1f}" for chain in model.chains)
    sure = "" if np.isnan(model.confidence) else f", confidence {model.confidence:.2f}"
    return f"{len(model.chains)} {'rope' if len(model.chains) == 1 else 'ropes'}, {lengths} mm{sure}"


def describe_timings(model: Model) -> str:
    """Table of the stages' times."""
    rows = [(name, f"{seconds * 1e3:.1f}") for name, seconds in model.timings.items()]
    return _table([("stage", "ms"), *rows, _total(model.timings, columns=2)])


def _handed_on(model: Model) -> dict[str, Any]:
    """Return the arrays between the stages, and those of the chains."""
    return {**model.stages, "chains": tuple(chain.points for chain in model.chains)}


def _shown(count: int | None) -> str:
    return "" if count is None else f"{count}"


def _points(stage: Any) -> int:
    """Points of an array, or of several."""
    return len(stage) if isinstance(stage, np.ndarray) else sum(len(points) for points in stage)


def _length(points: ArrayLike) -> float:
    return float(np.linalg.norm(np.diff(np.asarray(points), axis=0), axis=1).sum())


def _total(timings: Mapping[str, float], columns: int) -> tuple[str, ...]:
    return ("total", *[""] * (columns - 2), f"{sum(timings.values()) * 1e3:.1f}")


def _kinds(chain: Chain) -> str:
    """Kinds of a chain's doubts, the heaviest first, and how many more there are."""
    kinds = list(dict.fromkeys(doubt.kind for doubt in chain.doubts))
    more = [f"+{len(kinds) - _KINDS}"] if len(kinds) > _KINDS else []
    return ", ".join(kinds[:_KINDS] + more)


def _table(rows: Iterable[Sequence[str]], left: Container[int] = (0,)) -> str:
    """Columns side by side: some, by their numbers, flush left, the others flush right."""
    rows = list(rows)
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(
            cell.ljust(width) if column in left else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)
