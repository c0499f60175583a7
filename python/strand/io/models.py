"""Models read back from JSON files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np

from strand.chain import Chain
from strand.checks import number, whole
from strand.curve import Curve
from strand.files import JSON_BYTES, FileFormatError, open_file, parse_json, read_json, shown
from strand.model import FORMAT, VERSION, Alternative, Doubt, Join, Model, ModelWarning
from strand.sensor import Sensor


def load(path: str | os.PathLike[str], *, max_bytes: int = JSON_BYTES) -> Model:
    """Read a model that `Model.save` wrote.

    Parameters
    ----------
    path : str or path-like
        The JSON file.
    max_bytes : int
        How large it may be. What it says takes up to 25 times as much memory.

    Returns
    -------
    Model
        With the same chains, poses, deviations, timings, warnings, confidence, joins, doubts,
        alternatives and sensor, bit for bit; without stages.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If the file is truncated, is not a model, or is larger than `max_bytes`.
    """
    return _model(path, read_json(path, whole("max_bytes", max_bytes, 1)))


def load_frames(path: str | os.PathLike[str]) -> Iterator[tuple[int, int, Model | None]]:
    """Go through the models that `strand reconstruct --every` wrote, one in memory at a time.

    Parameters
    ----------
    path : str or path-like
        The file, with a line of JSON for each frame.

    Yields
    ------
    frame : int
        The frame's number in the recording.
    stamp : int
        Its time stamp, nanoseconds since 1970.
    model : Model or None
        None where the frame did not support an answer.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If a line is truncated, is no model's, or is longer than 64 MiB.
    """
    with open_file(path) as file:
        number = 0
        while line := file.readline(JSON_BYTES + 1):
            number += 1
            place = f"line {number}"
            if len(line) > JSON_BYTES:
                raise FileFormatError(path, f"longer than the {JSON_BYTES} bytes that may be read", place)
            data = parse_json(path, line, place)
            try:
                frame, stamp = whole("frame", data["frame"]), whole("stamp", data["stamp"])
                if "model" not in data:
                    str(data["error"])
            except (KeyError, TypeError, ValueError) as error:
                raise FileFormatError(path, f"not a frame's model ({error})", place) from error
            yield frame, stamp, _model(path, data["model"]) if "model" in data else None


def _model(path: str | os.PathLike[str], data: Any) -> Model:
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise FileFormatError(path, f"not a {FORMAT}")
    if data.get("version") != VERSION:
        raise FileFormatError(
            path, f"model version {shown(data.get('version'))}, this reads version {VERSION}"
        )
    try:
        return Model(
            chains=tuple(_chain(chain) for chain in data["chains"]),
            poses=np.asarray(data["poses"], dtype=np.float64).reshape(-1, 4, 4),
            timings={stage: number("timings", spent) for stage, spent in data["timings"].items()},
            warnings=tuple(ModelWarning(**warning) for warning in data["warnings"]),
            pose_sd=np.array(data["pose_sd"], dtype=np.float64).reshape(-1, 6),
            confidence=float("nan") if data["confidence"] is None else float(data["confidence"]),
            joins=tuple(Join(**join) for join in data["joins"]),
            doubts=tuple(Doubt(**doubt) for doubt in data["doubts"]),
            alternatives=tuple(_alternative(other) for other in data["alternatives"]),
            method=data["method"],
            sensor=None if data.get("sensor") is None else Sensor(**data["sensor"]),
        )
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise FileFormatError(path, f"not a {FORMAT} ({error})") from error


def _chain(data: dict[str, Any]) -> Chain:
    curve = data["curve"]
    kinds = {"points": float, "covariance": float, "points_seen": int, "views_seen": int}
    arrays: dict[str, Any] = {
        name: None if data[name] is None else np.asarray(data[name], kind) for name, kind in kinds.items()
    }
    if curve is not None:
        curve = Curve(np.asarray(curve["control"], dtype=np.float64), curve["start"], curve["stop"])
    return Chain(**{**data, **arrays, "curve": curve})


def _alternative(data: dict[str, Any]) -> Alternative:
    chains = tuple(np.asarray(nodes, dtype=np.float64).reshape(-1, 3) for nodes in data["chains"])
    return Alternative(data["cost"], chains)
