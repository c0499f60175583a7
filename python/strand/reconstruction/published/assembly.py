"""From reconnected segments to whole strings: trim, bridge, and carry on to where the string ends.

Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.config import Reconnection
from strand.geometry.polyline import bridge, end_direction, path_length, walk
from strand.reconstruction.published.reconnection import Reconnected
from strand.support.checks import Array

# an end is looked for this far ahead, in steps of this length, within this distance of the axis; in radii
_AHEAD, _STEP, _ASIDE = 4.0, 0.25, 0.75


def trim(segment: Array, front: float, back: float) -> Array:
    """Leave out the nodes nearer than `front` to the first and `back` to the last, metres of arc length.

    What would be left empty keeps its middle node.
    """
    s = path_length(segment)
    kept = segment[(s >= front) & (s <= s[-1] - back)]
    middle = len(segment) // 2
    return kept if len(kept) else segment[middle : middle + 1]


def reach_end(nodes: Array, axis: Array, density: float, radius: float, span: float) -> Array:
    """Carry a chain on beyond its last node, straight, to where the string ends.

    Averages over two radii (eq. 17-18) stop short of the end by about a radius, and tracing by up to r_n
    more. What is missing is found by counting: each step ahead adds the share of it that the axis points
    c_i = p_i - r n_i fill at the string's mean density.

    Parameters
    ----------
    nodes : (M, 3) ndarray
        Ordered nodes, metres.
    axis : (N, 3) ndarray
        Axis points before the average (eq. 16), metres.
    density : float
        How many of them there are for each metre of string.
    radius : float
        The string's radius, metres.
    span : float
        The stretch over which the end's direction is taken, metres of arc length.

    Returns
    -------
    (M or M + 1, 3) ndarray
        The nodes, with the end if it lies ahead.
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
    segments: Sequence[Array], reconnected: Reconnected, axis: Array, radius: float, config: Reconnection
) -> list[tuple[Array, bool]]:
    """Join segments to whole strings.

    Parameters
    ----------
    segments : sequence of (K, 3) ndarray
        Ordered nodes, metres.
    reconnected : Reconnected
    axis : (N, 3) ndarray
        Axis points before the average (eq. 16), metres.
    radius : float
        The string's radius, metres.
    config : Reconnection

    Returns
    -------
    list of ((M, 3) ndarray, bool)
        Nodes of each string from end to end, metres, and whether it is closed. Strings of one node are
        left out.
    """
    span, spacing = config.span * radius, radius
    cut_back = [config.trim * radius * (end in reconnected.meeting) for end in range(2 * len(segments))]
    trimmed = [trim(part, *cut_back[2 * k : 2 * k + 2]) for k, part in enumerate(segments)]
    strings = []
    for entered, closed in walk(len(segments), reconnected.joins):
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
                nodes = reach_end(nodes, axis, len(axis) / total, radius, span)[::-1]
            strings[i] = (nodes, closed)
    return strings
