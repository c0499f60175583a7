"""The state of a tracker as arrays, so that another process can go on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.geometry.plane import Plane
from strand.support.checks import Array, describe_value
from strand.tracking.certainty import pack_doubts, unpack_doubts
from strand.tracking.events import WatchedCrossing
from strand.tracking.holding import Held, Place
from strand.tracking.masks import Appearance
from strand.tracking.rope_state import COASTING, LOST, TENTATIVE, TRACKING, RopeState

VERSION = 1
_LARGEST = 1e6  # of a number in a state
_STATES = (TENTATIVE, TRACKING, COASTING, LOST)
_ARRAYS = ("nodes", "velocities", "last", "scalars", "covariances", "seen", "hidden")
_NUMBERS = ("radius", "spacing", "length_sd", "through", "confidence")


def _pack_rope(rope: RopeState) -> dict[str, NDArray[Any]]:
    """Return a rope's state as arrays by their names."""
    packed: dict[str, NDArray[Any]] = {name: np.array(getattr(rope, name)) for name in _ARRAYS}
    packed["numbers"] = np.array([getattr(rope, name) for name in _NUMBERS])
    label = -1 if rope.label is None else rope.label
    packed["integers"] = np.array(
        [
            rope.number,
            label,
            rope.generation,
            _STATES.index(rope.state),
            *rope.covered_ends,
            *rope.end_counts,
        ]
    )
    packed["doubts"] = np.array(pack_doubts(rope.doubts))
    packed["optional"] = np.array(
        [np.nan if value is None else value for value in (rope.slid, *rope.covers)], dtype=float
    )
    return packed


def _unpack_rope(packed: Mapping[str, NDArray[Any]]) -> RopeState:
    """Return the rope of `pack_rope`."""
    number, label, generation, state, *ends = (int(value) for value in packed["integers"])
    slid, *covers = (None if np.isnan(value) else float(value) for value in packed["optional"])
    values = dict(zip(_NUMBERS, map(float, packed["numbers"]), strict=True))
    count = len(packed["nodes"])
    shapes = {"scalars": (count, 3), "covariances": (count, 3, 3), "seen": (count,), "hidden": (count,)}
    found: dict[str, Any] = dict(values)
    for name in _ARRAYS:
        array = np.array(packed[name])
        shape = shapes.get(name, (count, 3))
        if array.shape != shape or not (np.abs(array.astype(float)) < _LARGEST).all():
            raise ValueError(f"{name} is not finite or not of shape {shape}")
        found[name] = array
    return RopeState(
        number=number,
        label=None if label < 0 else label,
        generation=generation,
        state=_STATES[state],
        slid=slid,
        covers=tuple(covers),
        covered_ends=(bool(ends[0]), bool(ends[1])),
        end_counts=(ends[2], ends[3]),
        doubts=unpack_doubts(str(packed["doubts"])) if "doubts" in packed else (),
        **found,
    )


@dataclass(frozen=True, eq=False)
class SavedState:
    """All that a tracker knows, without a reconstruction that runs beside it.

    Attributes
    ----------
    time : float or None
        Of the last frame, s; None before the first.
    count, since_opinion : int
        Frames so far, and since the last reconstruction.
    biases : (C,) ndarray
        Errors of depth of the cameras, metres.
    up : (3,) ndarray or None
    table : Plane or None
    ropes : tuple of RopeState
    crossings : tuple of WatchedCrossing
    holds : dict of Place to Held
    appearances : tuple of Appearance or None
        Of each camera.
    """

    time: float | None
    count: int
    since_opinion: int
    biases: Array
    up: Array | None
    table: Plane | None
    ropes: tuple[RopeState, ...]
    crossings: tuple[WatchedCrossing, ...]
    holds: dict[Place, Held]
    appearances: tuple[Appearance | None, ...]


def pack_state(saved: SavedState) -> dict[str, NDArray[Any]]:
    """Return a state as arrays by their names."""
    table = saved.table
    crossings = [(*one.ropes, *one.s, one.height, one.count, one.made, one.margin) for one in saved.crossings]
    holds = [(*place, *held.point, *held.velocity, _or_nan(held.time)) for place, held in saved.holds.items()]
    packed: dict[str, NDArray[Any]] = {
        "version": np.array(VERSION),
        "time": np.array(_or_nan(saved.time)),
        "counts": np.array([saved.count, len(saved.ropes), saved.since_opinion]),
        "biases": np.array(saved.biases, dtype=float),
        "up": np.zeros(0) if saved.up is None else np.array(saved.up, dtype=float),
        "table": np.zeros(0) if table is None else np.append(table.normal, table.offset),
        "crossings": np.array(crossings, dtype=float).reshape(-1, 8),
        "holds": np.array(holds, dtype=float).reshape(-1, 9),
    }
    for i, rope in enumerate(saved.ropes):
        packed |= {f"rope{i}.{name}": array for name, array in _pack_rope(rope).items()}
    for i, seen in enumerate(saved.appearances):
        if seen is not None:
            packed[f"colors{i}"] = np.stack([seen.ropes, seen.others])
    return packed


def unpack_state(state: Mapping[str, Any]) -> SavedState:
    """Return the state of `pack_state`.

    Raises
    ------
    ValueError
        If the mapping is not a tracker's state, or of another version.
    """
    if not isinstance(state, Mapping):
        raise TypeError(f"state: expected a mapping of arrays, got {type(state).__name__}")
    for name in ("version", "time", "counts", "biases", "up", "table", "crossings", "holds"):
        if name not in state:
            raise ValueError(f"state: expected the arrays of Tracker.state, got none named {name!r}")
    version = np.asarray(state["version"])
    if version.dtype.kind not in "iu" or version.shape or version != VERSION:
        raise ValueError(f"state: expected version {VERSION}, got {describe_value(version.tolist())}")
    try:
        return _unpack(state)
    except (KeyError, IndexError, TypeError, ValueError) as error:
        raise ValueError(f"state: expected the arrays of Tracker.state, unchanged: {error}") from error


def _unpack(state: Mapping[str, Any]) -> SavedState:
    for name in ("biases", "up", "table", "crossings"):
        if not np.isfinite(np.asarray(state[name], dtype=float)).all():
            raise ValueError(f"{name} is not finite")
    count, ropes, since = (int(value) for value in np.asarray(state["counts"]))
    time = float(np.asarray(state["time"]))
    up, table = np.array(state["up"]), np.array(state["table"])
    if len(up) not in (0, 3) or len(table) not in (0, 4) or min(count, ropes, since) < 0:
        raise ValueError("up, table or counts have a wrong size")
    biases = np.array(state["biases"], dtype=float)
    holds = {}
    for rope, s, *rest in np.asarray(state["holds"]).tolist():
        at = None if np.isnan(rest[6]) else rest[6]
        holds[int(rope), s] = Held(np.array(rest[:3]), np.array(rest[3:6]), at)
    return SavedState(
        time=None if np.isnan(time) else time,
        count=count,
        since_opinion=since,
        biases=biases,
        up=up if len(up) else None,
        table=Plane(table[:3], float(table[3])) if len(table) else None,
        ropes=tuple(_unpack_rope(_split_names(state, f"rope{i}.")) for i in range(ropes)),
        crossings=tuple(
            WatchedCrossing((int(a), int(b)), (s, t), height, int(seen), bool(made), margin)
            for a, b, s, t, height, seen, made, margin in np.asarray(state["crossings"]).tolist()
        ),
        holds=holds,
        appearances=tuple(
            Appearance(*np.asarray(state[f"colors{i}"])) if f"colors{i}" in state else None
            for i in range(len(biases))
        ),
    )


def _split_names(state: Mapping[str, Any], prefix: str) -> dict[str, NDArray[Any]]:
    """Return the arrays whose names begin with a prefix, without it."""
    return {name[len(prefix) :]: np.asarray(state[name]) for name in state if name.startswith(prefix)}


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value
