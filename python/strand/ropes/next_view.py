"""The camera position that best sees a place among ropes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.geometry.line import Line
from strand.support.checks import Array

_DIRECTIONS = 600  # tried camera directions
_MAX_TURN = np.radians(45.0)  # radians between a tried direction and the mean of the cameras' directions
_STRETCH = 5.0  # radii of rope to see on each side of the place
_CLEAR_DISTANCE = 3.0  # radii: strands farther apart in the image do not hide each other
_MAX_NODES = 24  # of the stretch that are looked at
_ALONG_WEIGHT = 0.5  # weight of a view along the rope, against an unhindered view
_NEAR_WEIGHT = 0.3  # weight of a direction near an old camera's, against an unhindered view


def find_weakest_place(lines: Sequence[Line]) -> Array:
    """Return the node (3,) that fewest points support; the middle of the first line if that is unknown."""
    weakest = [(int(one.points_seen.min()), k) for k, one in enumerate(lines) if one.points_seen is not None]
    line = lines[min(weakest)[1]] if weakest else lines[0]
    seen = line.points_seen
    return np.asarray(line.points[len(line.points) // 2 if seen is None else int(seen.argmin())])


def find_best_camera(place: Array, lines: Sequence[Line], cameras: Array) -> Array:
    """Find the camera position (3,) that best sees a place among ropes, see `Model.next_view`.

    There, strands hide each other little, the camera sees them from the side, and no camera (V, 3) was near.
    """
    radius = lines[0].radius
    offsets = cameras - place
    distances = np.linalg.norm(offsets, axis=1)
    # skip cameras at the place: they have no direction
    kept = np.isfinite(distances) & (distances > 0)
    offsets, distances = offsets[kept], distances[kept]
    if not len(offsets):
        raise ValueError("model: expected poses with cameras away from the ropes")
    seen_from = offsets / distances[:, None]
    up = seen_from.mean(axis=0)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else seen_from[0]
    # a spiral of directions, evenly over a cap
    k = np.arange(_DIRECTIONS) + 0.5
    cosine = 1.0 - k / _DIRECTIONS * (1.0 - np.cos(_MAX_TURN))
    turn = np.pi * (1.0 + 5.0**0.5) * k
    sine = np.sqrt(1.0 - cosine**2)
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    directions = (
        (sine * np.cos(turn))[:, None] * side + (sine * np.sin(turn))[:, None] * other + cosine[:, None] * up
    )
    value = -_NEAR_WEIGHT * (directions @ seen_from.T).max(axis=1)
    strands = [line.points for line in lines]
    nodes = np.concatenate(strands)
    number = np.repeat(np.arange(len(strands)), [len(strand) for strand in strands])
    steps = [np.linalg.norm(np.diff(strand, axis=0), axis=1) for strand in strands]
    along = np.concatenate([np.concatenate([[0.0], np.cumsum(step)]) for step in steps])
    tangents = np.concatenate([np.gradient(strand, axis=0) for strand in strands])
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    wanted = np.flatnonzero(np.linalg.norm(nodes - place, axis=1) < _STRETCH * radius)
    if not len(wanted):
        wanted = np.array([np.linalg.norm(nodes - place, axis=1).argmin()])
    wanted = wanted[:: max(len(wanted) // _MAX_NODES, 1)]
    for i in wanted:
        own = (number == number[i]) & (np.abs(along - along[i]) < _STRETCH * radius)
        between = nodes[~own] - nodes[i]
        clear = np.full(_DIRECTIONS, _CLEAR_DISTANCE * radius)
        if len(between):
            ahead = between @ directions.T
            aside = np.sqrt(np.maximum((between**2).sum(axis=1)[:, None] - ahead**2, 0.0))
            clear = np.minimum(clear, np.where(ahead > 0, aside, np.inf).min(axis=0))
        value += (clear / radius - _ALONG_WEIGHT * np.abs(directions @ tangents[i])) / len(wanted)
    return np.asarray(place + np.median(distances) * directions[int(value.argmax())])
