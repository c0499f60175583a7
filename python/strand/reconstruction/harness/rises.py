"""Places where a strand rises over nothing: there it lies on an end that no place shows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.geometry.polyline import path_length
from strand.support.checks import Array

_STEP = 0.25  # distance of the places where heights count, radii
_AT_ENDS = 4.0  # length of a strand at free ends that may rise, radii
_REACH = 12.0  # distance within which a strand comes down on both sides, radii
_RISE = 0.8  # height over both sides at least, radii
_NEAR = 1.5  # distance in the plan of a strand that lies below or above at most, sums of their radii
_OWN = 6.0  # length of a strand around a place that does not lie below it, radii

Line = tuple[Array, float, bool]
"""Nodes (M, 3), metres, a radius, metres, and whether the first node follows the last."""


def list_rises(lines: Sequence[Line], up: Array) -> list[Array]:
    """Return places (3,) where strands on a table rise and come down, and no other strand is near.

    Each strand has one at most.

    Parameters
    ----------
    lines : sequence of Line
    up : (3,) ndarray
        Unit vector away from the table.
    """
    rises = []
    for number, line in enumerate(lines):
        others = [other for place, other in enumerate(lines) if place != number]
        place = _find_rise(line, others, up)
        if place is not None:
            rises.append(place)
    return rises


def _find_rise(line: Line, others: Sequence[Line], up: Array) -> Array | None:
    """Return the highest place over both sides of a strand without a strand near; None if there is none."""
    nodes, radius, closed = line
    if closed:
        nodes = np.concatenate([nodes, nodes[:1]])
    along = path_length(nodes)
    s = np.arange(0.0, along[-1], _STEP * radius)
    places = np.column_stack([np.interp(s, along, nodes[:, axis]) for axis in range(3)])
    reach = min(round(_REACH / _STEP), len(s) - 1)
    heights = places @ up
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(heights, reach, mode="wrap" if closed else "edge"), reach + 1
    )
    sides = windows[: len(s)], windows[reach:]
    rise = heights - np.maximum(*(side.min(axis=1) for side in sides))
    # a place on the way up is none
    rise[heights < np.maximum(*(side.max(axis=1) for side in sides))] = 0.0
    if not closed:
        at_ends = round(_AT_ENDS / _STEP)
        rise[:at_ends] = rise[len(s) - min(at_ends, len(s)) :] = 0.0
    for k in np.flatnonzero(rise > _RISE * radius):
        own = np.abs(s - s[k])
        own = np.minimum(own, along[-1] - own) if closed else own
        below = [(places[own > _OWN * radius], radius), *((other[0], other[1]) for other in others)]
        if not any(_is_near(places[k], some, radius + its, up) for some, its in below):
            return np.asarray(places[k])
    return None


def _is_near(place: Array, nodes: Array, radii: float, up: Array) -> bool:
    """Tell whether some of nodes (M, 3) lie near a place (3,) in the plan."""
    _, aside = measure_offsets(nodes, place, up)
    return bool((aside < _NEAR * radii).any())


def measure_offsets(nodes: Array, place: Array, up: Array) -> tuple[Array, Array]:
    """Return how far nodes (M, 3) lie above a place (3,), and aside in the plan, both (M,) metres."""
    offsets = nodes - place
    rise = offsets @ up
    return rise, np.linalg.norm(offsets - np.outer(rise, up), axis=1)
