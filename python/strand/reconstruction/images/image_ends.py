"""Where ropes end by the depths of all pixels."""

from __future__ import annotations

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.geometry.polyline import path_length
from strand.reconstruction.images.table_plane import Plane
from strand.support.checks import Array

# how far along the rope ends are looked for, and in which steps, radii; nodes that say where it goes there
_REACH, _STEP, _AHEAD = 3.0, 0.375, 4
# ends are led on from so much before them, radii, and may fall to the table this steeply
_FROM, _FALLS = (0.0, 1.5, 3.0), (0.0, 0.4)
# directions of which less than this is left point nowhere
_STEEP = 0.1


def ends_moved(images: RopeImages, fit: ImageFit, table: Plane, noise: float, radius: float) -> ImageFit:
    """Return a fit of which the ropes end where the depths of all pixels agree most.

    Parameters
    ----------
    images : RopeImages
    fit : ImageFit
    table : Plane
    noise : float
        Standard deviation of depth, metres.
    radius : float
        Metres.

    Returns
    -------
    ImageFit
        The same one if all ends are best where they are.
    """
    chains = list(fit.nodes)
    steps = np.arange(_STEP, _REACH + 0.5 * _STEP, _STEP) * radius
    changes = [(0.0, 0.0, 0.0), *((float(step), 0.0, 0.0) for step in steps)]
    for cut in (part * radius for part in _FROM):
        changes += [(cut, cut + float(step), fall) for fall in _FALLS for step in steps]
    moved = False
    for number in range(len(chains)):
        for _ in range(2):
            nodes = chains[number]
            ways = [_changed(nodes, *change, table, radius) for change in changes]
            stem = _stem(nodes, radius)
            rest = [*chains[:number], nodes[:stem], *chains[number + 1 :]]
            ends = [way[stem - 1 :] for way in ways]
            # of ends that depth tells as well, as behind other strands, the one that was found
            best = int(np.argmax(images.end_gains(rest, ends, fit.corrections, table, noise)))
            moved |= best > 0
            # both ends in turn, and back in order
            chains[number] = np.ascontiguousarray(ways[best][::-1])
    return images.through(fit, chains) if moved else fit


def _changed(nodes: Array, cut: float, added: float, slope: float, table: Plane, radius: float) -> Array:
    """Return a rope that is cut before its end, but not before its middle, and led on from there.

    Nothing carries what is led on: it does not rise, and may fall until it lies on the table.

    Parameters
    ----------
    nodes : (M, 3) ndarray
    cut, added : float
        How much is taken away, and then added, metres.
    slope : float
        By how much it falls for each length that it goes on.
    table : Plane
    radius : float
        Metres.
    """
    s = path_length(nodes)
    if cut > 0.0:
        length = max(s[-1] - cut, 0.5 * s[-1])
        last = [np.interp(length, s, nodes[:, k]) for k in range(3)]
        nodes = np.vstack([nodes[s < length], last])
    normal, offset = table
    ahead = nodes[-1] - nodes[-min(_AHEAD, len(nodes))]
    ahead /= max(float(np.linalg.norm(ahead)), 1e-12)
    ahead -= (max(float(ahead @ normal), 0.0) + slope) * normal
    if added == 0.0 or np.linalg.norm(ahead) < slope + _STEEP:
        return nodes
    more = nodes[-1] + np.arange(_STEP * radius, added + 1e-9, _STEP * radius)[:, None] * ahead
    above = more @ normal - offset
    low = min(radius, float(nodes[-1] @ normal) - offset)
    return np.vstack([nodes, more + np.maximum(low - above, 0.0)[:, None] * normal])


def _stem(nodes: Array, radius: float) -> int:
    """Return how many nodes all ways of an end begin with."""
    s = path_length(nodes)
    length = s[-1] - (_REACH + 1.0) * radius
    if length < 0.5 * s[-1]:
        length = 0.4 * s[-1]
    return max(int(np.searchsorted(s, length)), 2)
