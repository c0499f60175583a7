"""A table of a recording's frames as CSV: a row for each rope of each frame, and one for a frame without."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

from strand.ropes.model import Model

COLUMNS = (
    *("frame", "stamp", "rope", "length", "radius", "confidence", "model_confidence"),
    *("x_first", "y_first", "z_first", "x_last", "y_last", "z_last", "error"),
)
"""Lengths and places are in metres, stamps in nanoseconds since 1970."""


def format_head() -> bytes:
    """Return the line with the names of the columns."""
    return _format([COLUMNS])


def format_frame(number: int, stamp: int, model: Model | None, error: str = "") -> bytes:
    """Return the rows of a frame: its number, its time, and its ropes or why it has none."""
    chains = () if model is None else model.chains
    if model is None or not chains:
        return _format([(number, stamp, *[""] * (len(COLUMNS) - 3), error)])
    return _format(
        [
            (
                *(number, stamp, rope, chain.length, chain.radius),
                *(_or_empty(chain.confidence), _or_empty(model.confidence)),
                *(*chain.points[0].tolist(), *chain.points[-1].tolist(), ""),
            )
            for rope, chain in enumerate(chains)
        ]
    )


def _or_empty(value: float) -> float | str:
    return value if value == value else ""


def _format(rows: Sequence[Sequence[object]]) -> bytes:
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()
