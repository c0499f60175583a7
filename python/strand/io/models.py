"""Load models from JSON files."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from strand.geometry.curve import Curve
from strand.ropes.chain import Chain
from strand.ropes.crossings import Crossing
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode
from strand.ropes.model import FORMAT, VERSION, Model
from strand.ropes.seen_side import USUAL_UP, check_table, check_up
from strand.support.checks import check_integer, check_number, check_sequence, check_stamp, describe_value
from strand.support.files import (
    JSON_BYTES,
    FileFormatError,
    decode_json,
    open_file,
    parse_json,
    read_head,
    read_json,
)
from strand.views.sensor import Sensor

REQUIRED = (  # keys that a model file must have
    *("chains", "poses", "timings", "warnings", "pose_sd", "confidence", "joins", "doubts", "alternatives"),
    *("method", "branch"),
)
_FRAME_START = re.compile(rb'\s*\{\s*"frame"\s*:')  # of a line for `load_frames`


def load_model(path: str | os.PathLike[str], *, max_bytes: int = JSON_BYTES) -> Model:
    """Load a model that `Model.save` wrote.

    Parameters
    ----------
    path : str or path-like
        The JSON file.
    max_bytes : int
        Half of the memory that text and values of the file may take, 224 MiB by default. The file of a model
        may have some 0.3 `max_bytes`.

    Returns
    -------
    Model
        Equal to the saved one, bit for bit, but without stages. A file from before models had `up` and
        `table` gives `up` (0, 0, 1), as its crossings, and no table.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    strand.FileFormatError
        If the file is truncated, is not a model, or may take more than 2 x `max_bytes`. `place` names the
        key, such as `chains[0]`, and `reason` says what is wrong there.
    """
    most = check_integer("max_bytes", max_bytes, 1)
    if _FRAME_START.match(read_head(path)):
        raise FileFormatError(path, f"not a {FORMAT}, but models of frames: use strand.io.models.load_frames")
    return _parse_model(path, read_json(path, most))


def load_frames(path: str | os.PathLike[str]) -> Iterator[tuple[int, int, Model | None]]:
    """Yield the models that `strand reconstruct --every` wrote, one in memory at a time.

    Parameters
    ----------
    path : str or path-like
        The file, with one line of JSON for each frame.

    Yields
    ------
    frame : int
        The number of the frame in the recording.
    stamp : int
        Its time stamp, nanoseconds since 1970.
    model : Model or None
        None if reconstruction raised an error for the frame.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    strand.FileFormatError
        If a line is truncated, is not a frame, or takes more than 448 MiB of memory.
    """
    with open_file(path) as file:
        number = 0
        while line := file.readline(JSON_BYTES + 1):
            number += 1
            place = f"line {number}"
            if len(line) > JSON_BYTES:
                raise FileFormatError(path, f"longer than the {JSON_BYTES} bytes that may be read", place)
            text = decode_json(path, line, place=place)
            del line
            yield _parse_frame(path, text, place)
            del text


def _parse_frame(path: str | os.PathLike[str], text: str, place: str) -> tuple[int, int, Model | None]:
    data = parse_json(path, text, place)
    try:
        frame, stamp = check_integer("frame", data["frame"]), check_integer("stamp", data["stamp"])
        if "model" not in data:
            str(data["error"])
    except (KeyError, TypeError, ValueError) as error:
        raise FileFormatError(path, f"not a frame's model ({error})", place) from error
    return frame, stamp, _parse_model(path, data["model"]) if "model" in data else None


def _parse_model(path: str | os.PathLike[str], data: Any) -> Model:
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise FileFormatError(path, f"not a {FORMAT}")
    if data.get("version") != VERSION:
        raise FileFormatError(
            path, f"model version {describe_value(data.get('version'))}, this reads version {VERSION}"
        )
    missing = [key for key in REQUIRED if key not in data]
    if missing:
        raise FileFormatError(path, f"not a {FORMAT}: missing {', '.join(missing)}")
    makers: dict[str, Callable[[Any], Any]] = {
        "chains": _parse_chain,
        "warnings": lambda warning: ModelWarning(**warning),
        "joins": lambda join: Join(**join),
        "doubts": lambda doubt: Doubt(**doubt),
        "alternatives": _parse_alternative,
    }
    values: dict[str, Any] = {key: _parse_list(path, key, data[key], make) for key, make in makers.items()}
    # check the file's crossings, then drop them: the model computes them from its chains and doubts
    _parse_list(path, "crossings", data.get("crossings", []), lambda crossing: Crossing(**crossing))
    with _locate_errors(path, "poses"):
        values["poses"] = np.asarray(data["poses"], dtype=np.float64).reshape(-1, 4, 4)
    with _locate_errors(path, "pose_sd"):
        values["pose_sd"] = np.array(data["pose_sd"], dtype=np.float64).reshape(-1, 6)
    with _locate_errors(path, "timings"):
        values["timings"] = {stage: check_number(stage, spent) for stage, spent in data["timings"].items()}
    with _locate_errors(path, "confidence"):
        values["confidence"] = _parse_confidence(data["confidence"])
    with _locate_errors(path, "sensor"):
        values["sensor"] = None if data.get("sensor") is None else Sensor(**data["sensor"])
    with _locate_errors(path, "up"):
        # older files have none: their crossings are seen along z
        values["up"] = check_up("up", data.get("up", USUAL_UP))
    with _locate_errors(path, "table"):
        table = data.get("table")
        values["table"] = None if table is None else check_table("table", (table["normal"], table["offset"]))
    with _locate_errors(path, "stamp"):
        values["stamp"] = check_stamp("stamp", data.get("stamp"))
    with _locate_errors(path, "harness"):
        harness = data.get("harness")
        values["harness"] = None if harness is None else parse_harness(harness, values["chains"])
    with _locate_errors(path, None):
        return Model(method=data["method"], branch=data["branch"], **values)


@contextmanager
def _locate_errors(path: str | os.PathLike[str], place: str | None) -> Iterator[None]:
    """Convert errors to FileFormatError with a place in the file."""
    try:
        yield
    except KeyError as error:
        raise FileFormatError(path, f"not a {FORMAT}: missing {error.args[0]}", place) from error
    except (AttributeError, OverflowError, TypeError, ValueError) as error:
        raise FileFormatError(path, f"not a {FORMAT} ({error})", place) from error


def _parse_list(
    path: str | os.PathLike[str], key: str, entries: Any, make: Callable[[Any], Any]
) -> tuple[Any, ...]:
    """Make a value of each entry of a list."""
    made = []
    with _locate_errors(path, key):
        listed = check_sequence(key, entries, "values")
    for i, entry in enumerate(listed):
        with _locate_errors(path, f"{key}[{i}]"):
            made.append(make(entry))
    return tuple(made)


def _parse_chain(data: dict[str, Any]) -> Chain:
    curve = data["curve"]
    kinds = {"points": float, "covariance": float, "points_seen": int, "views_seen": int}
    arrays: dict[str, Any] = {
        name: None if data[name] is None else np.asarray(data[name], kind) for name, kind in kinds.items()
    }
    if curve is not None:
        curve = Curve(np.asarray(curve["control"], dtype=np.float64), curve["start"], curve["stop"])
    doubts = tuple(Doubt(**doubt) for doubt in data["doubts"])
    # older files have none
    color = data.get("color")
    sure = _parse_confidence(data["confidence"])
    return Chain(**{**data, **arrays, "curve": curve, "doubts": doubts, "confidence": sure, "color": color})


def parse_harness(data: dict[str, Any], chains: tuple[Chain, ...]) -> Harness:
    """Make a harness; the chains are those of its edges, in their order."""
    edges = check_sequence("edges", data["edges"], "edges")
    if len(edges) != len(chains):
        raise ValueError(f"edges: expected one for each chain ({len(chains)}), got {len(edges)}")
    return Harness(
        tuple(_parse_node(node) for node in check_sequence("nodes", data["nodes"], "nodes")),
        tuple(HarnessEdge(chain=chain, **edge) for chain, edge in zip(chains, edges, strict=True)),
    )


def _parse_node(data: dict[str, Any]) -> HarnessNode:
    covariance = data["covariance"]
    node = HarnessNode(
        data["id"],
        np.asarray(data["position"], np.float64),
        None if covariance is None else np.asarray(covariance, np.float64),
        data["degree"],
        _parse_confidence(data["confidence"]),
    )
    if data["kind"] != node.kind:
        raise ValueError(f"kind: expected {node.kind!r} with a degree of {node.degree}")
    return node


def _parse_confidence(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _parse_alternative(data: dict[str, Any]) -> Alternative:
    chains = tuple(np.asarray(nodes, dtype=np.float64).reshape(-1, 3) for nodes in data["chains"])
    # older files have none
    return Alternative(data["cost"], chains, _parse_confidence(data.get("probability")))
