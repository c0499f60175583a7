"""What notebooks show of a model or a chain: a small plot as SVG, and a few numbers."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from strand.report.sheet import PALETTE
from strand.support.checks import Array

if TYPE_CHECKING:
    from strand.ropes.chain import Chain
    from strand.ropes.model import Model

_SIDE, _MARGIN = 260, 12  # pixels
_MOST_NODES, _MOST_CHAINS, _MOST_DOUBTS = 2000, 20, 5


def chain_html(chain: Chain) -> str:
    """Return a chain's plot along the world axis in which it extends least, with its numbers."""
    return f"<div>{_plot([chain], ())}<div>{escape(repr(chain))}</div></div>"


def model_html(model: Model) -> str:
    """Return a model's chains in one plot, with its numbers and its greatest doubts."""
    places = [doubt.place for doubt in model.doubts if doubt.place is not None]
    lines = repr(model).splitlines() + [f"  {doubt}" for doubt in model.doubts[:_MOST_DOUBTS]]
    if len(model.doubts) > _MOST_DOUBTS:
        lines.append(f"  and {len(model.doubts) - _MOST_DOUBTS} more doubts")
    said = "<br>".join(escape(line) for line in lines)
    return f"<div>{_plot(model.chains[:_MOST_CHAINS], places)}<div>{said}</div></div>"


def _plot(chains: Sequence[Chain], doubts: Sequence[Array]) -> str:
    """Draw chains as seen along the world axis in which they extend least; empty without chains."""
    if not chains:
        return ""
    paths = [np.vstack([c.points, c.points[:1]]) if c.closed else c.points for c in chains]
    nodes = np.concatenate(paths)
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    across, up = sorted(np.argsort(high - low, kind="stable")[1:].tolist())
    span = float((high - low).max())
    scale = (_SIDE - 2 * _MARGIN) / span
    width, height = (2 * _MARGIN + scale * (high - low)[[across, up]]).tolist()

    def pixels(points: Array) -> Array:
        right, above = (scale * (points - low)[:, [across, up]]).T
        return np.column_stack([_MARGIN + right, height - _MARGIN - above])

    every = max(-(-len(nodes) // _MOST_NODES), 1)
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
    axes = f"{'xyz'[across]} to the right, {'xyz'[up]} up; {span * 1e3:.0f} mm across"
    size = f'width="{width:.0f}" height="{height:.0f}"'
    return f'<svg {size} style="background:#fff"><title>{axes}</title>{"".join(marks)}</svg>'
