"""The plot of ropes that notebooks show, as SVG, and the colours of ropes."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from strand.geometry.line import Line
from strand.support.checks import Array

PALETTE = ("#1f77b4", "#ff7f0e", "#2ca02c", "#d62728", "#9467bd", "#8c564b", "#e377c2", "#17becf", "#bcbd22")
"""Colours of ropes, in their order, in all pictures."""

_SIDE = 260  # pixels: width and height of the plot, at most
_MARGIN = 12  # pixels
_MAX_NODES = 2000  # drawn in one plot
_MAX_LINES = 20  # drawn in one plot


def make_html(
    lines: Sequence[Line], text: Sequence[str], towards: Array, doubts: Sequence[Array] = ()
) -> str:
    """Return a plot of lines above lines of text.

    The plot looks along the world axis in which the lines extend least, from the side of the vector `towards`
    (3,). Red rings mark the places (3,) of doubts.
    """
    said = "<br>".join(escape(row) for row in text)
    return f"<div>{_draw(lines[:_MAX_LINES], towards, doubts)}<div>{said}</div></div>"


def _draw(lines: Sequence[Line], towards: Array, doubts: Sequence[Array]) -> str:
    """Draw lines as SVG; empty without any."""
    if not lines:
        return ""
    paths = [np.vstack([c.points, c.points[:1]]) if c.closed else c.points for c in lines]
    nodes = np.concatenate(paths)
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    least, *most = np.argsort(high - low, kind="stable").tolist()
    across, up = sorted(most)
    # from behind the axis the other one of the two points down, as in a camera's image
    flipped = bool(towards[least] < 0)
    span = float((high - low).max())
    scale = (_SIDE - 2 * _MARGIN) / span
    width, height = (2 * _MARGIN + scale * (high - low)[[across, up]]).tolist()

    def pixels(points: Array) -> Array:
        right, above = (scale * (points - low)[:, [across, up]]).T
        return np.column_stack([_MARGIN + right, _MARGIN + above if flipped else height - _MARGIN - above])

    every = max(-(-len(nodes) // _MAX_NODES), 1)
    marks = []
    for i, path in enumerate(paths):
        kept = np.unique(np.append(np.arange(0, len(path), every), len(path) - 1))
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in pixels(path[kept]))
        stroke = f'fill="none" stroke="{PALETTE[i % len(PALETTE)]}" stroke-width="2.5"'
        marks.append(f'<polyline points="{points}" {stroke}/>')
    if doubts:
        marks += [
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="6" fill="none" stroke="#d62728"/>'
            for x, y in pixels(np.array(doubts))
        ]
    axes = (
        f"{'xyz'[across]} to the right, {'xyz'[up]} {'down' if flipped else 'up'}; {span * 1e3:.0f} mm across"
    )
    size = f'width="{width:.0f}" height="{height:.0f}"'
    return f'<svg {size} style="background:#fff"><title>{axes}</title>{"".join(marks)}</svg>'
