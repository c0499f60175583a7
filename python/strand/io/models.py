"""Models read back from JSON files."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from strand.chain import Chain
from strand.checks import number, whole
from strand.curve import Curve
from strand.doubt import Doubt
from strand.files import JSON_BYTES, FileFormatError, read_json, shown
from strand.model import FORMAT, VERSION, Alternative, Join, Model, ModelWarning
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
    data = read_json(path, whole("max_bytes", max_bytes, 1))
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
            confidence=_confidence(data["confidence"]),
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
    doubts = tuple(Doubt(**doubt) for doubt in data["doubts"])
    sure = _confidence(data["confidence"])
    return Chain(**{**data, **arrays, "curve": curve, "doubts": doubts, "confidence": sure})


def _confidence(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _alternative(data: dict[str, Any]) -> Alternative:
    chains = tuple(np.asarray(nodes, dtype=np.float64).reshape(-1, 3) for nodes in data["chains"])
    return Alternative(data["cost"], chains)
