"""Count the points and chains of each stage, compare with the truth, and format tables of text."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand.ropes.chain import Chain
from strand.ropes.crossings import NOT_LISTED
from strand.ropes.harness import Harness
from strand.ropes.model import Model, list_model_crossings
from strand.ropes.summary import format_confidence, say_whether_to_act
from strand.support.checks import check_finite_array, check_instance
from strand.views.view import View

# the stages of each branch or method, each with the key of its points in Model.stages, or None if it has no
# points; the last stage makes the model's chains
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
    "harness": {
        "extract": "raw",
        "radius": None,
        "filter": "filtered",
        "register": "registered",
        "map": None,
        "places": "arcs",
        "arcs": None,
        "link": None,
        "fit": "chains",
        "ends": None,
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
# keys of Model.stages that are counted, and their names in tables
COUNTED = {
    "tubes": {"arcs": "arcs seen", "chains": "whole ropes"},
    "images": {"readings": "ropes in the readings compared", "chains": "whole ropes"},
    "harness": {"arcs": "strands seen", "chains": "edges of the graph"},
    "published": {
        "traced": "chains traced",
        "segments": "segments after the split",
        "chains": "whole strings",
    },
}
PAPER_COUNTS = (3, 7, 1)  # of COUNTED["published"], in the paper's experiment
_MAX_KINDS = 2  # kinds of doubt in a row, so that a table fits in 80 columns
_MAX_CROSSINGS = 30  # rows of the table of crossings
_SPACING = 1e-3  # metres between the places where a chain is compared with the truth


@dataclass(frozen=True)
class StageCount:
    """Points into and out of one stage.

    Attributes
    ----------
    name : str
    points_in, points_out : int or None
        Points before and after the stage; nodes of arcs and chains count as points. None for a stage that
        estimates the radius or works on curves.
    seconds : float
    """

    name: str
    points_in: int | None
    points_out: int | None
    seconds: float


@dataclass(frozen=True)
class Accuracy:
    """The error of a chain against the true centreline.

    Attributes
    ----------
    length_error : float
        Relative error of the length; positive if the chain is too long.
    rms : float
        Root mean square distance of the chain, sampled every 1 mm, from the centreline, metres.
    """

    length_error: float
    rms: float


def find_branch(model: Model) -> str:
    """Return the branch, or else the method, whose stages a model has; raise ValueError without stages.

    A model with a harness has stages of its own, whatever its method.
    """
    name = check_instance("model", model, Model).branch or model.method
    name = name if model.harness is None else "harness"
    if not model.stages or name not in STAGE_ARRAYS:
        raise ValueError("model: expected one with its stages, from reconstruct(..., keep_stages=True)")
    return name


def take_stage(model: Model, key: str) -> Any:
    """Return what a model keeps of a stage; raise ValueError if it was made without."""
    stages = check_instance("model", model, Model).stages
    if key not in stages:
        raise ValueError(
            f"model: expected one with the stage {key!r}, from reconstruct(..., keep_stages=True)"
        )
    return stages[key]


def count_stages(views: Sequence[View], model: Model) -> tuple[StageCount, ...]:
    """Count the points in and out of each stage that ran; the model needs its stages."""
    arrays = _list_stages(model)
    counts = []
    before = sum(len(view.points) for view in views)
    for name, key in STAGE_ARRAYS[find_branch(model)].items():
        if name not in model.timings:
            continue
        if key is None:
            counts.append(StageCount(name, None, None, model.timings[name]))
            continue
        after = _count_points(arrays[key])
        counts.append(StageCount(name, before, after, model.timings[name]))
        before = after
    return tuple(counts)


def count_chains(model: Model) -> tuple[int, ...]:
    """Count arcs, segments and chains, as listed in `COUNTED`; the model needs its stages."""
    arrays = _list_stages(model)
    return tuple(len(arrays[key]) for key in COUNTED[find_branch(model)])


def measure_accuracy(chain: Chain, truth: ArrayLike) -> Accuracy:
    """Compare a chain with the (M, 3) nodes of the true centreline, world frame, metres.

    The `rms` uses the nearest place of the centreline to each place of the chain. Missing parts of the
    chain do not change it; they show in `length_error`.
    """
    true = Chain(check_finite_array("truth", truth, ("N", 3)), chain.radius)
    places = np.linspace(0.0, chain.length, max(round(chain.length / _SPACING) + 1, 2))
    distances = true.nearest(chain.at(places)).distance
    rms = float(np.sqrt(np.mean(distances**2)))
    return Accuracy(chain.length / true.length - 1.0, rms)


def describe_stages(views: Sequence[View], model: Model) -> str:
    """Format the stages: points in, points out, milliseconds."""
    rows = [
        (
            count.name,
            _format_count(count.points_in),
            _format_count(count.points_out),
            f"{count.seconds * 1e3:.1f}",
        )
        for count in count_stages(views, model)
    ]
    return _format_table(
        [("stage", "points in", "points out", "ms"), *rows, _make_total_row(model.timings, columns=4)]
    )


def describe_counts(model: Model) -> str:
    """Format the counts of `count_chains`; for the published method, beside those of the paper."""
    made_by = find_branch(model)
    names, counts = COUNTED[made_by].values(), map(str, count_chains(model))
    if made_by == "published":
        return _format_table(
            [("", "here", "paper"), *zip(names, counts, map(str, PAPER_COUNTS), strict=True)]
        )
    return _format_table([("", "here"), *zip(names, counts, strict=True)])


def describe_accuracy(model: Model, truth: Sequence[ArrayLike]) -> str:
    """Format one line for each rope: its length and its error against the true centreline.

    The longest chain is compared with the longest centreline, and so on; the rest is skipped.
    """
    lines = []
    centerlines = sorted(truth, key=_measure_length, reverse=True)
    for i, (chain, true) in enumerate(zip(model.chains, centerlines, strict=False)):
        error = measure_accuracy(chain, true)
        lines.append(
            f"rope {i}: length {chain.length * 1e3:.1f} mm, truth {_measure_length(true) * 1e3:.1f} mm "
            f"({error.length_error:+.2%}), RMS distance from truth {error.rms * 1e3:.2f} mm"
        )
    return "\n".join(lines)


def describe_chains(model: Model) -> str:
    """Format the chains: length, nodes, radius, ends, and, if known, confidence and doubts.

    The ends of a harness's chains are its junctions and ends, such as J1 and E2.
    """
    sure = any(not np.isnan(chain.confidence) for chain in model.chains)
    rows = [
        (
            f"{i}",
            f"{chain.length * 1e3:.1f}",
            f"{len(chain.points)}",
            f"{chain.radius * 1e3:.2f}",
            describe_ends(model, i),
            *((format_confidence(chain.confidence), _list_kinds(chain)) if sure else ()),
        )
        for i, chain in enumerate(model.chains)
    ]
    more = ("confidence", "doubts") if sure else ()
    return _format_table([("chain", "length / mm", "nodes", "radius / mm", "ends", *more), *rows], (0, 6))


def describe_edge(harness: Harness, number: int) -> str:
    """Say between which nodes an edge runs, and how many wires it has if that is known."""
    edge = harness.edges[number]
    names = [f"{harness.nodes[node].kind[0].upper()}{node}" for node in (edge.start, edge.stop)]
    wires = "" if edge.wires is None else f", {edge.wires} {'wire' if edge.wires == 1 else 'wires'}"
    return f"{names[0]} to {names[1]}{wires}"


def describe_ends(model: Model, number: int) -> str:
    """Say between which nodes of a harness a chain runs, or whether it is closed or has hidden ends."""
    chain = model.chains[number]
    if model.harness is not None:
        return describe_edge(model.harness, number)
    if chain.closed:
        return "closed"
    return {
        (False, False): "open",
        (True, False): "first hidden",
        (False, True): "last hidden",
        (True, True): "both hidden",
    }[chain.hidden_ends]


def describe_crossings(model: Model) -> str:
    """Format the crossings seen from above: strands, gap, angle, sign and probability; empty without any."""
    met = list_model_crossings(model)
    if met is None:
        return NOT_LISTED
    rows = [
        (
            *(f"{chain} at {s * 1e3:.1f}" for chain, s in (one.over, one.under)),
            f"{one.gap * 1e3:.1f}",
            f"{np.degrees(one.angle):.0f}",
            f"{one.sign:+d}",
            f"{one.probability:.3f}",
        )
        for one in met[:_MAX_CROSSINGS]
    ]
    if not rows:
        return ""
    head = ("over: chain at mm", "under", "gap / mm", "angle / °", "sign", "probability")
    more = f"\nand {len(met) - _MAX_CROSSINGS} more crossings" if len(met) > _MAX_CROSSINGS else ""
    return _format_table([head, *rows]) + more


def describe_confidence(model: Model) -> str:
    """Say in one line how sure all ropes together are, and whether to act."""
    return say_whether_to_act(model.confidence)


def describe_frame(model: Model) -> str:
    """Format the lengths and the confidence of a recording's frame in one line."""
    lengths = ", ".join(f"{chain.length * 1e3:.1f}" for chain in model.chains)
    sure = "" if np.isnan(model.confidence) else f", confidence {format_confidence(model.confidence)}"
    return f"{len(model.chains)} {'rope' if len(model.chains) == 1 else 'ropes'}, {lengths} mm{sure}"


def describe_timings(model: Model) -> str:
    """Format the times of the stages."""
    rows = [(name, f"{seconds * 1e3:.1f}") for name, seconds in model.timings.items()]
    return _format_table([("stage", "ms"), *rows, _make_total_row(model.timings, columns=2)])


def _list_stages(model: Model) -> dict[str, Any]:
    """Return the arrays between the stages, and the nodes of the chains."""
    return {**model.stages, "chains": tuple(chain.points for chain in model.chains)}


def _format_count(count: int | None) -> str:
    return "" if count is None else f"{count}"


def _count_points(stage: Any) -> int:
    """Return the number of points in an array, or in several."""
    return len(stage) if isinstance(stage, np.ndarray) else sum(len(points) for points in stage)


def _measure_length(points: ArrayLike) -> float:
    return float(np.linalg.norm(np.diff(np.asarray(points), axis=0), axis=1).sum())


def _make_total_row(timings: Mapping[str, float], columns: int) -> tuple[str, ...]:
    return ("total", *[""] * (columns - 2), f"{sum(timings.values()) * 1e3:.1f}")


def _list_kinds(chain: Chain) -> str:
    """Return the kinds of a chain's doubts, the heaviest first, and the number of further kinds."""
    kinds = list(dict.fromkeys(doubt.kind for doubt in chain.doubts))
    more = [f"+{len(kinds) - _MAX_KINDS}"] if len(kinds) > _MAX_KINDS else []
    return ", ".join(kinds[:_MAX_KINDS] + more)


def _format_table(rows: Iterable[Sequence[str]], left: Container[int] = (0,)) -> str:
    """Return rows as text in columns; columns in `left` are flush left, others flush right."""
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
