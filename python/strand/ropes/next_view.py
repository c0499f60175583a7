"""Where a camera would best see a place among ropes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.support.checks import Array

# directions that are tried, and how far they may turn from the mean of the views that there are, radians
_DIRECTIONS, _WIDEST = 600, np.radians(45.0)
# the stretch of rope to see, on each side of the place, and where strands are clear of each other, in radii
_STRETCH, _CLEAR = 5.0, 3.0
# weights of seeing strands from the side, and from where no camera was, against an unhindered view of them
_SIDE, _NEW = 0.5, 0.3


def find_best_camera(place: Array, strands: Sequence[Array], cameras: Array, radius: float) -> Array:
    """Find the camera position that best sees a place.

    Strands near the place should hide each other as little as possible, and be seen from the side, not along
    them, and from where no camera was yet.

    Parameters
    ----------
    place : (3,) ndarray
        World frame, metres.
    strands : sequence of (M, 3) ndarray
        All ropes' nodes in order, metres.
    cameras : (V, 3) ndarray
        Where the cameras were, metres.
    radius : float
        The ropes' radius, metres.

    Returns
    -------
    (3,) ndarray
        World frame, metres; as far from the place as the cameras were, in the median.

    Raises
    ------
    ValueError
        If all cameras are at the place.
    """
    offsets = cameras - place
    distances = np.linalg.norm(offsets, axis=1)
    # a camera at the place saw it from no side
    somewhere = np.isfinite(distances) & (distances > 0)
    offsets, distances = offsets[somewhere], distances[somewhere]
    if not len(offsets):
        raise ValueError("model: expected poses with cameras away from the ropes")
    seen_from = offsets / distances[:, None]
    up = seen_from.mean(axis=0)
    up = up / np.linalg.norm(up) if np.linalg.norm(up) > 1e-6 else seen_from[0]
    # a spiral of directions evenly over the cap
    k = np.arange(_DIRECTIONS) + 0.5
    cosine = 1.0 - k / _DIRECTIONS * (1.0 - np.cos(_WIDEST))
    turn = np.pi * (1.0 + 5.0**0.5) * k
    sine = np.sqrt(1.0 - cosine**2)
    side = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    side /= np.linalg.norm(side)
    other = np.cross(up, side)
    directions = (
        (sine * np.cos(turn))[:, None] * side + (sine * np.sin(turn))[:, None] * other + cosine[:, None] * up
    )
    value = -_NEW * (directions @ seen_from.T).max(axis=1)
    nodes = np.concatenate(strands)
    number = np.repeat(np.arange(len(strands)), [len(strand) for strand in strands])
    steps = [np.linalg.norm(np.diff(strand, axis=0), axis=1) for strand in strands]
    along = np.concatenate([np.concatenate([[0.0], np.cumsum(step)]) for step in steps])
    tangents = np.concatenate([np.gradient(strand, axis=0) for strand in strands])
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    wanted = np.flatnonzero(np.linalg.norm(nodes - place, axis=1) < _STRETCH * radius)
    if not len(wanted):
        wanted = np.array([np.linalg.norm(nodes - place, axis=1).argmin()])
    wanted = wanted[:: max(len(wanted) // 24, 1)]
    for i in wanted:
        own = (number == number[i]) & (np.abs(along - along[i]) < _STRETCH * radius)
        between = nodes[~own] - nodes[i]
        clear = np.full(_DIRECTIONS, _CLEAR * radius)
        if len(between):
            ahead = between @ directions.T
            aside = np.sqrt(np.maximum((between**2).sum(axis=1)[:, None] - ahead**2, 0.0))
            clear = np.minimum(clear, np.where(ahead > 0, aside, np.inf).min(axis=0))
        value += (clear / radius - _SIDE * np.abs(directions @ tangents[i])) / len(wanted)
    return np.asarray(place + np.median(distances) * directions[int(value.argmax())])
