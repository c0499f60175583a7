"""Make the traces of plotly's 3D figures: points, lines and markers, in millimetres."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand.report.drawing import INK
from strand.support.checks import Array

_MAX_TEXT = 240  # characters of a text
_TEXT_WIDTH = 60  # characters of a line of text


class Pen:
    """A maker of plotly's traces, in millimetres from an origin near the ropes."""

    def __init__(self, origin: Array) -> None:
        self.origin = origin

    def draw_lines(
        self, lines: Sequence[Array], name: str, color: str, width: int, **more: Any
    ) -> dict[str, Any]:
        """Return one trace of several polylines."""
        line = {"color": color, "width": width}
        return (
            self.make_trace(join_with_gaps(lines), "lines", name) | {"line": line, "hoverinfo": "skip"} | more
        )

    def draw_markers(
        self, points: Array, name: str, marker: dict[str, Any], texts: Sequence[str], **more: Any
    ) -> dict[str, Any]:
        """Return one trace of markers, whose texts appear under the pointer."""
        text = {"text": [_wrap_text(text) for text in texts], "hoverinfo": "text"}
        edged = {"line": {"color": INK, "width": 1}} | marker
        return self.make_trace(points, "markers", name) | {"marker": edged} | text | more

    def make_trace(self, points: Array, mode: str, name: str) -> dict[str, Any]:
        """Return a trace of (N, 3) points, world frame, metres."""
        x, y, z = (pack_numbers(column) for column in (1e3 * (points - self.origin)).T)
        return {"type": "scatter3d", "x": x, "y": y, "z": z, "mode": mode, "name": name}


def pack_numbers(values: ArrayLike) -> dict[str, Any]:
    """Return numbers in plotly's text format: 32-bit floats in base 64."""
    array = np.ascontiguousarray(values, dtype="<f4")
    entry = {"dtype": "f4", "bdata": b64encode(array.tobytes()).decode()}
    return entry if array.ndim == 1 else {**entry, "shape": ", ".join(map(str, array.shape))}


def join_with_gaps(parts: Sequence[Array]) -> Array:
    """Return the rows of several parts, with a row of NaN after each."""
    columns = parts[0].shape[1:] if parts else (3,)
    gap = np.full((1, *columns), np.nan)
    return np.concatenate([np.empty((0, *columns)), *(rows for part in parts for rows in (part, gap))])


def _wrap_text(text: str) -> str:
    """Return text for plotly, with markup escaped and lines wrapped."""
    lines = [""]
    for word in text[:_MAX_TEXT].split():
        if lines[-1] and len(lines[-1]) + len(word) > _TEXT_WIDTH:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "<br>".join(escape(line) for line in lines)
