"""The table's schema: a row for each rope of each frame, and one for each frame without an answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.ropes.chain import Chain
from strand.ropes.crossings import Crossing
from strand.support.checks import Array
from strand.support.extras import import_extra

SCHEMA_VERSION = 1
"""Is raised when columns change; what shards say in their metadata under `strand.schema`."""

UNLIKE = "seconds"
"""The only column in which two runs differ."""


@dataclass(frozen=True, eq=False)
class Row:
    """A rope of a frame, or a frame without one.

    Attributes
    ----------
    recording : str
    frame : int or None
        None: the recording could not be opened.
    time : float or None
        Seconds since 1970.
    seconds : float
        How long the frame took, reading included.
    rope : int or None
        The chain's number in its model; None: there is none.
    chain : Chain or None
    model_confidence : float
        NaN if there is no model, or its method does not say.
    warnings : sequence of str
        "kind: message" of the warnings about this rope, and of those about none.
    crossings : sequence of Crossing
        Those at which this rope is on top.
    error : str or None
        "Kind: message" if there is no answer.
    """

    recording: str
    frame: int | None
    time: float | None
    seconds: float
    rope: int | None = None
    chain: Chain | None = None
    model_confidence: float = float("nan")
    warnings: Sequence[str] = ()
    crossings: Sequence[Crossing] = ()
    error: str | None = None


@cache
def schema() -> Any:
    """Return the schema, a `pyarrow.Schema`: columns, their types, and what they may leave out.

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
            pa.field("model_confidence", pa.float64()),
            pa.field("warnings", pa.list_(pa.string()), nullable=False),
            pa.field("crossings", pa.list_(crossing)),
            pa.field("version", pa.string(), nullable=False),
            pa.field("configuration", pa.string(), nullable=False),
            pa.field("seconds", pa.float64(), nullable=False),
            pa.field("error", pa.string()),
        ]
    )


def record_batch(rows: Sequence[Row], version: str, configuration: str) -> Any:
    """Return rows as a `pyarrow.RecordBatch` of the schema."""
    pa = import_extra("pyarrow")
    columns = schema()
    chains = [row.chain for row in rows]
    covariances = [None if chain is None else chain.covariance for chain in chains]
    values = {
        "recording": [row.recording for row in rows],
        "frame": [row.frame for row in rows],
        "time": [row.time for row in rows],
        "rope": [row.rope for row in rows],
        "nodes": _nested([None if chain is None else chain.points for chain in chains], 3),
        "arc_length": _lists([None if chain is None else chain.arc_length for chain in chains]),
        "covariance": _nested(
            [None if array is None else array.reshape(len(array), 9) for array in covariances], 9
        ),
        "radius": [None if chain is None else chain.radius for chain in chains],
        "closed": [None if chain is None else chain.closed for chain in chains],
        "confidence": [None if chain is None else _known(chain.confidence) for chain in chains],
        "model_confidence": [_known(row.model_confidence) for row in rows],
        "warnings": [[_readable(words) for words in row.warnings] for row in rows],
        "crossings": [
            None if row.chain is None else [_crossing(one) for one in row.crossings] for row in rows
        ],
        "version": [version] * len(rows),
        "configuration": [configuration] * len(rows),
        "seconds": [row.seconds for row in rows],
        "error": [None if row.error is None else _readable(row.error) for row in rows],
    }
    arrays = [
        value if isinstance(value, pa.Array) else pa.array(value, field.type)
        for field, value in zip(columns, values.values(), strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=columns)


def _crossing(one: Crossing) -> dict[str, Any]:
    return {
        "over_rope": one.over[0],
        "over_at": one.over[1],
        "under_rope": one.under[0],
        "under_at": one.under[1],
        "point_over": one.point_over.tolist(),
        "point_under": one.point_under.tolist(),
        "height": one.height,
        "height_sd": _known(one.height_sd),
        "gap": one.gap,
        "angle": one.angle,
        "sign": one.sign,
        "probability": _known(one.probability),
    }


def _readable(words: str) -> str:
    """Return text as tables hold it, UTF-8: names of files in it may have any bytes."""
    return words.encode("utf-8", "backslashreplace").decode("utf-8")


def _known(value: float) -> float | None:
    return None if np.isnan(value) else value


def _lists(arrays: Sequence[Array | None]) -> Any:
    """Return a list for each array; null where there is none."""
    pa = import_extra("pyarrow")
    return pa.ListArray.from_arrays(_offsets(arrays), pa.array(_flat(arrays)))


def _nested(arrays: Sequence[Array | None], width: int) -> Any:
    """Return a list of lists for each array (N, width); null where there is none."""
    pa = import_extra("pyarrow")
    flat = _flat(arrays)
    inner = np.arange(0, len(flat) + 1, width, dtype=np.int32)
    return pa.ListArray.from_arrays(_offsets(arrays), pa.ListArray.from_arrays(inner, pa.array(flat)))


def _flat(arrays: Sequence[Array | None]) -> Array:
    there = [np.ravel(array) for array in arrays if array is not None]
    return np.concatenate(there) if there else np.empty(0)


def _offsets(arrays: Sequence[Array | None]) -> Any:
    """Where each array's rows begin, and where the last one's end; null before what is not there."""
    pa = import_extra("pyarrow")
    sizes = [0 if array is None else len(array) for array in arrays]
    places: NDArray[np.int32] = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
    return pa.array(places, mask=np.array([*(array is None for array in arrays), False]))
