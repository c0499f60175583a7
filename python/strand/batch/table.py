"""The schema of tables: one row per rope of each frame, and one per frame without an answer."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from strand.geometry.plane import Plane
from strand.ropes.chain import Chain
from strand.ropes.crossings import Crossing
from strand.ropes.harness import Harness, describe_harness
from strand.support.checks import Array
from strand.support.columns import make_lists, make_nested_lists
from strand.support.extras import import_extra
from strand.support.files import convert_to_json
from strand.tracking.events import Event
from strand.tracking.track import Track, TrackedRope

SCHEMA_VERSION = 4
"""Version of the columns, which files hold in their metadata as `strand.schema`."""

VARYING_COLUMN = "seconds"
"""The only column in which two runs differ."""


@dataclass(frozen=True, eq=False)
class Row:
    """A rope of a frame, or a frame without one.

    Attributes
    ----------
    recording : str
    frame : int or None
        None if the recording could not be opened.
    time : float or None
        Time of the frame's latest view, seconds since 1970, as `Model.stamp`; of a track, that of its nodes.
    seconds : float
        Duration of the work on the frame, reading included.
    rope : int or None
        Number of the chain in its model, or of the tracked rope; None without a chain.
    chain : Chain or None
        A `TrackedRope` if the ropes are tracked.
    model_confidence : float
        NaN without a model, or if its method has no confidence.
    warnings : sequence of str
        "kind: message" for each warning about this rope or about no rope.
    crossings : sequence of Crossing, optional
        The crossings at which this rope is on top; None if they are too many to list.
    error : str or None
        "Kind: message" if there is no answer.
    up : (3,) ndarray or None
        `Model.up`; None without a model.
    table : Plane or None
        `Model.table`.
    track : Track or None
        The tracker's answer that has the rope.
    harness : Harness or None
        `Model.harness`, in the first row of its frame.
    """

    recording: str
    frame: int | None
    time: float | None
    seconds: float
    rope: int | None = None
    chain: Chain | None = None
    model_confidence: float = float("nan")
    warnings: Sequence[str] = ()
    crossings: Sequence[Crossing] | None = ()
    error: str | None = None
    up: Array | None = None
    table: Plane | None = None
    track: Track | None = None
    harness: Harness | None = None


@cache
def make_schema() -> Any:
    """Return the table's columns and types, a `pyarrow.Schema`.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    """
    pa = import_extra("pyarrow")
    place = pa.list_(pa.float64())
    crossing = pa.struct(
        [
            ("over_rope", pa.int32()),
            ("over_at", pa.float64()),
            ("under_rope", pa.int32()),
            ("under_at", pa.float64()),
            ("point_over", place),
            ("point_under", place),
            ("height", pa.float64()),
            ("height_sd", pa.float64()),
            ("gap", pa.float64()),
            ("angle", pa.float64()),
            ("sign", pa.int8()),
            ("probability", pa.float64()),
        ]
    )
    event = pa.struct(
        [
            ("kind", pa.string()),
            ("s", pa.float64()),
            ("under_rope", pa.int32()),
            ("under_s", pa.float64()),
            ("doubtful", pa.bool_()),
        ]
    )
    return pa.schema(
        [
            pa.field("recording", pa.string(), nullable=False),
            pa.field("frame", pa.int64()),
            pa.field("time", pa.float64()),
            pa.field("rope", pa.int32()),
            pa.field("nodes", pa.list_(place)),
            pa.field("arc_length", pa.list_(pa.float64())),
            pa.field("covariance", pa.list_(place)),
            pa.field("radius", pa.float64()),
            pa.field("closed", pa.bool_()),
            pa.field("confidence", pa.float64()),
            pa.field("label", pa.int64()),
            pa.field("color", place),
            pa.field("hidden_ends", pa.list_(pa.bool_())),
            pa.field("model_confidence", pa.float64()),
            pa.field("up", place),
            pa.field("table", place),
            pa.field("warnings", pa.list_(pa.string()), nullable=False),
            pa.field("crossings", pa.list_(crossing)),
            pa.field("graph", pa.string()),
            pa.field("state", pa.string()),
            pa.field("generation", pa.int32()),
            pa.field("length_sd", pa.float64()),
            pa.field("velocity", pa.list_(place)),
            pa.field("seen", pa.list_(pa.bool_())),
            pa.field("predicted", pa.list_(pa.bool_())),
            pa.field("age", pa.list_(pa.float64())),
            pa.field("image_times", pa.list_(pa.float64())),
            pa.field("unexplained", pa.float64()),
            pa.field("events", pa.list_(event)),
            pa.field("version", pa.string(), nullable=False),
            pa.field("configuration", pa.string(), nullable=False),
            pa.field("seconds", pa.float64(), nullable=False),
            pa.field("error", pa.string()),
        ]
    )


def make_record_batch(rows: Sequence[Row], version: str, configuration: str) -> Any:
    """Return rows as a `pyarrow.RecordBatch` with the columns of the schema."""
    pa = import_extra("pyarrow")
    columns = make_schema()
    chains = [row.chain for row in rows]
    tracked = [chain if isinstance(chain, TrackedRope) else None for chain in chains]
    tracks = [row.track for row in rows]
    covariances = [None if chain is None else chain.covariance for chain in chains]
    values = {
        "recording": [row.recording for row in rows],
        "frame": [row.frame for row in rows],
        "time": [row.time for row in rows],
        "rope": [row.rope for row in rows],
        "nodes": make_nested_lists([None if chain is None else chain.points for chain in chains], 3),
        "arc_length": make_lists([None if chain is None else chain.arc_length for chain in chains]),
        "covariance": make_nested_lists(
            [None if array is None else array.reshape(len(array), 9) for array in covariances], 9
        ),
        "radius": [None if chain is None else chain.radius for chain in chains],
        "closed": [None if chain is None else chain.closed for chain in chains],
        "confidence": [None if chain is None else _replace_nan(chain.confidence) for chain in chains],
        "label": [None if chain is None else chain.label for chain in chains],
        "color": [None if chain is None or chain.color is None else chain.color.tolist() for chain in chains],
        "hidden_ends": [None if chain is None else list(chain.hidden_ends) for chain in chains],
        "model_confidence": [_replace_nan(row.model_confidence) for row in rows],
        "up": [None if row.up is None else row.up.tolist() for row in rows],
        "table": [
            None if row.table is None else [*row.table.normal.tolist(), row.table.offset] for row in rows
        ],
        "warnings": [[_escape_bytes(text) for text in row.warnings] for row in rows],
        "crossings": [
            None
            if row.chain is None or row.crossings is None
            else [_convert_crossing(crossing) for crossing in row.crossings]
            for row in rows
        ],
        "graph": [None if row.harness is None else _format_graph(row.harness) for row in rows],
        "state": [None if rope is None else rope.state for rope in tracked],
        "generation": [None if rope is None else rope.generation for rope in tracked],
        "length_sd": [None if rope is None else rope.length_sd for rope in tracked],
        "velocity": make_nested_lists([None if rope is None else rope.velocity for rope in tracked], 3),
        "seen": make_lists([None if rope is None else rope.seen for rope in tracked], np.bool_),
        "predicted": make_lists([None if rope is None else rope.predicted for rope in tracked], np.bool_),
        "age": make_lists([None if rope is None else rope.age for rope in tracked]),
        "image_times": [None if track is None else list(track.image_times) for track in tracks],
        "unexplained": [None if track is None else track.unexplained for track in tracks],
        "events": [
            None
            if row.track is None
            else [_convert_event(event) for event in row.track.events if event.rope == row.rope]
            for row in rows
        ],
        "version": [version] * len(rows),
        "configuration": [configuration] * len(rows),
        "seconds": [row.seconds for row in rows],
        "error": [None if row.error is None else _escape_bytes(row.error) for row in rows],
    }
    arrays = [
        value if isinstance(value, pa.Array) else pa.array(value, field.type)
        for field, value in zip(columns, values.values(), strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=columns)


def _convert_crossing(crossing: Crossing) -> dict[str, Any]:
    return {
        "over_rope": crossing.over[0],
        "over_at": crossing.over[1],
        "under_rope": crossing.under[0],
        "under_at": crossing.under[1],
        "point_over": crossing.point_over.tolist(),
        "point_under": crossing.point_under.tolist(),
        "height": crossing.height,
        "height_sd": _replace_nan(crossing.height_sd),
        "gap": crossing.gap,
        "angle": crossing.angle,
        "sign": crossing.sign,
        "probability": _replace_nan(crossing.probability),
    }


def _format_graph(harness: Harness) -> str:
    """Return a harness as JSON: that of a model's file, with what edges have in the rows of their chains."""
    graph = describe_harness(harness)
    for edge, described in zip(harness.edges, graph["edges"], strict=True):
        described |= {name: getattr(edge, name) for name in ("length", "radius", "radius_sd")}
    return json.dumps(convert_to_json(graph))


def _convert_event(event: Event) -> dict[str, Any]:
    under, under_s = (None, None) if event.under is None else event.under
    return {
        "kind": event.kind,
        "s": event.s,
        "under_rope": under,
        "under_s": under_s,
        "doubtful": event.doubtful,
    }


def _escape_bytes(text: str) -> str:
    """Return valid UTF-8: names of files in a text may have any bytes."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _replace_nan(value: float) -> float | None:
    return None if np.isnan(value) else value
