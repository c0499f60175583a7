"""A table of tracked ropes: one row for each rope and frame."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from strand.support.columns import make_lists, make_nested_lists
from strand.support.extras import import_extra
from strand.support.files import replace_file
from strand.tracking.events import Event
from strand.tracking.track import Track, TrackedRope

SCHEMA_VERSION = 1
"""Version of the columns, which files hold in their metadata as `strand.tracks`."""

_VERSION_KEY = "strand.tracks"
_BUFFERED = 200  # rows that are written at once; a row takes some 10 kB


@dataclass(frozen=True, eq=False)
class _Row:
    """A rope of a frame, or a frame without one."""

    frame: int
    time: float | None
    track: Track | None = None
    rope: TrackedRope | None = None
    error: str | None = None

    @property
    def events(self) -> list[Event]:
        """The events of the rope since the frame before."""
        if self.track is None or self.rope is None:
            return []
        return [event for event in self.track.events if event.rope == self.rope.number]


class TrackTable:
    """A table that is being written; `open_table` makes it.

    Parameters
    ----------
    file : binary file
    """

    def __init__(self, file: Any) -> None:
        options = {"compression": "snappy", "use_dictionary": False, "store_schema": False}
        self._file = import_extra("pyarrow.parquet").ParquetWriter(file, make_schema(), **options)
        self._file.add_key_value_metadata({_VERSION_KEY: f"{SCHEMA_VERSION}"})
        self._rows: list[_Row] = []

    def add(self, frame: int, track: Track) -> None:
        """Add the answer for a frame: a row for each rope, or one row without a rope."""
        self._rows += [_Row(frame, track.time, track, rope) for rope in track.ropes or (None,)]
        self._write(_BUFFERED)

    def add_error(self, frame: int, time: float | None, error: str) -> None:
        """Add a frame that could not be read."""
        self._rows.append(_Row(frame, time, error=error))

    def finish(self) -> None:
        """Write the last rows."""
        self._write(1)

    def close(self) -> None:
        """Write the end of the file."""
        self._file.close()

    def _write(self, least: int) -> None:
        if len(self._rows) >= least:
            self._file.write_batch(_make_batch(self._rows))
            self._rows = []


@contextmanager
def open_table(path: str | os.PathLike[str]) -> Iterator[TrackTable]:
    """Open a Parquet file for tracks; an existing one is replaced when the new one is complete.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    OSError
        If the file cannot be written.
    """
    import_extra("pyarrow.parquet")
    with replace_file(path) as file:
        table = TrackTable(file)
        try:
            yield table
            table.finish()
        finally:  # of an incomplete file too, which its writer would end after it is gone
            table.close()


def write_tracks(tracks: Iterable[Track], path: str | os.PathLike[str]) -> int:
    """Write the answers of a tracker to a Parquet file, one row for each rope and frame.

    Parameters
    ----------
    tracks : iterable of Track
        They are numbered from 0; some 200 rows are in memory at a time.
    path : str or path-like
        An existing file is replaced when the new one is complete.

    Returns
    -------
    int
        The number of tracks.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    OSError
        If the file cannot be written.
    """
    count = 0
    with open_table(path) as table:
        for count, track in enumerate(tracks, 1):
            table.add(count - 1, track)
    return count


@cache
def make_schema() -> Any:
    """Return the table's columns and types, a `pyarrow.Schema`.

    Raises
    ------
    ImportError
        If pyarrow is not installed.
    """
    pa = import_extra("pyarrow")
    numbers = pa.list_(pa.float64())
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
            pa.field("frame", pa.int64(), nullable=False),
            pa.field("time", pa.float64()),
            pa.field("image_times", numbers),
            pa.field("rope", pa.int32()),
            pa.field("label", pa.int64()),
            pa.field("generation", pa.int32()),
            pa.field("state", pa.string()),
            pa.field("length", pa.float64()),
            pa.field("length_sd", pa.float64()),
            pa.field("radius", pa.float64()),
            pa.field("confidence", pa.float64()),
            pa.field("nodes", pa.list_(numbers)),
            pa.field("s", numbers),
            pa.field("velocity", pa.list_(numbers)),
            pa.field("covariance", pa.list_(numbers)),
            pa.field("seen", pa.list_(pa.bool_())),
            pa.field("predicted", pa.list_(pa.bool_())),
            pa.field("age", numbers),
            pa.field("unexplained", pa.float64()),
            pa.field("up", numbers),
            pa.field("events", pa.list_(event), nullable=False),
            pa.field("error", pa.string()),
        ]
    )


def _make_batch(rows: list[_Row]) -> Any:
    pa = import_extra("pyarrow")
    tracks, ropes = [row.track for row in rows], [row.rope for row in rows]

    def pick(name: str) -> list[Any]:
        return [None if rope is None else getattr(rope, name) for rope in ropes]

    covariances = [None if one is None else np.reshape(one, (-1, 9)) for one in pick("covariance")]
    values = {
        "frame": [row.frame for row in rows],
        "time": [row.time for row in rows],
        "image_times": [None if track is None else list(track.image_times) for track in tracks],
        "rope": pick("number"),
        "label": pick("label"),
        "generation": pick("generation"),
        "state": pick("state"),
        "length": pick("length"),
        "length_sd": pick("length_sd"),
        "radius": pick("radius"),
        "confidence": [None if one is None or np.isnan(one) else one for one in pick("confidence")],
        "nodes": make_nested_lists(pick("points"), 3),
        "s": make_lists(pick("s")),
        "velocity": make_nested_lists(pick("velocity"), 3),
        "covariance": make_nested_lists(covariances, 9),
        "seen": make_lists(pick("seen"), np.bool_),
        "predicted": make_lists(pick("predicted"), np.bool_),
        "age": make_lists(pick("age")),
        "unexplained": [None if track is None else track.unexplained for track in tracks],
        "up": [None if track is None else track.up.tolist() for track in tracks],
        "events": [[_convert_event(event) for event in row.events] for row in rows],
        "error": [row.error for row in rows],
    }
    arrays = [
        value if isinstance(value, pa.Array) else pa.array(value, field.type)
        for field, value in zip(make_schema(), values.values(), strict=True)
    ]
    return pa.RecordBatch.from_arrays(arrays, schema=make_schema())


def _convert_event(event: Event) -> dict[str, Any]:
    under, under_s = (None, None) if event.under is None else event.under
    return {
        "kind": event.kind,
        "s": event.s,
        "under_rope": under,
        "under_s": under_s,
        "doubtful": event.doubtful,
    }
