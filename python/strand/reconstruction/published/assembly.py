"""Join segments to whole strings: trim them, bridge the gaps, and extend them to the string's ends.

Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.config import Reconnection
from strand.geometry.polyline import bridge, end_direction, order_segments, path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.published.reconnection import SegmentJoins
from strand.support.checks import Array

_AHEAD = 4.0  # radii: how far beyond a chain its end is searched
_STEP = 0.25  # radii: stretch whose axis points are counted together
_ASIDE = 0.75  # radii: axis points farther from the chain's straight extension do not count


def trim_segment(segment: Array, front: float, back: float) -> Array:
    """Drop the nodes nearer than `front` to the first and `back` to the last, metres; keep at least one."""
    s = path_length(segment)
    kept = segment[(s >= front) & (s <= s[-1] - back)]
    middle = len(segment) // 2
    return kept if len(kept) else segment[middle : middle + 1]


def extend_to_end(nodes: Array, axis: Array, density: float, radius: float, span: float) -> Array:
    """Add the string's end, straight ahead of the last node, if it lies there.

    Averages over two radii (eq. 17-18) stop about a radius before the end, and tracing up to r_n more. Each
    step ahead adds the share of it that the axis points c_i = p_i - r n_i (eq. 16) fill at their density,
    points per metre of string. The end's direction is taken over `span`, metres.
    """
    direction = end_direction(nodes, 0.0, span)
    offset = axis - nodes[-1]
    ahead = offset @ direction
    near = (ahead > 0) & (ahead < _AHEAD * radius)
    offset, ahead = offset[near], ahead[near]
    aside = np.linalg.norm(offset - ahead[:, None] * direction, axis=1)
    step = _STEP * radius
    ahead = ahead[aside < _ASIDE * radius]
    counts = np.bincount((ahead / step).astype(np.int64))
    missing = float(np.minimum(counts / (density * step), 1.0).sum()) * step
    return np.vstack([nodes, nodes[-1] + missing * direction]) if missing > 0 else nodes


def assemble(
    segments: Sequence[Array], joined: SegmentJoins, axis: Array, radius: float, config: Reconnection
) -> Chains:
    """Join segments to whole strings; drop strings of one node.

    `axis` holds the (N, 3) axis points before the average (eq. 16).
    """
    span, spacing = config.span * radius, radius
    cut_back = [config.trim * radius * (end in joined.meeting) for end in range(2 * len(segments))]
    trimmed = [trim_segment(part, *cut_back[2 * k : 2 * k + 2]) for k, part in enumerate(segments)]
    strings: Chains = []
    for entered, closed in order_segments(len(segments), joined.joins):
        parts = [trimmed[end // 2][:: -1 if end % 2 else 1] for end in entered]
        nodes = parts[0]
        for part in parts[1:]:
            nodes = np.vstack([nodes, bridge(nodes, part, span, spacing), part])
        if closed:
            nodes = np.vstack([nodes, bridge(nodes, parts[0], span, spacing)])
        if len(nodes) > 1:
            strings.append((_core.straighten(nodes, radius, span), closed))
    total = sum(path_length(nodes)[-1] for nodes, _ in strings)
    for i, (nodes, closed) in enumerate(strings):
        if not closed:
            for _ in range(2):
                nodes = extend_to_end(nodes, axis, len(axis) / total, radius, span)[::-1]
            strings[i] = (nodes, closed)
    return strings
