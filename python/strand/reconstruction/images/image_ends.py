"""Ends of ropes by the depths of all pixels."""

from __future__ import annotations

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.geometry.plane import Plane
from strand.geometry.polyline import path_length
from strand.support.checks import Array

_REACH = 3.0  # radii along the rope: ends are sought this far from where they are
_STEP = 0.375  # radii between ends that are tried
_NODES_AHEAD = 4  # nodes before an end that give its direction
_CUTS = (0.0, 1.5, 3.0)  # radii that are cut off before an end is extended
_SLOPES = (0.0, 0.4)  # fall towards the table per length of an extension
_MIN_AHEAD = 0.1  # length of what is left of a direction of unit length: with less it points nowhere
_MIN_REST = 8.0  # radii that are left of a rope whose ends are cut
_ROUNDS = 2  # an end and the other one


def move_ends(images: RopeImages, fit: ImageFit, table: Plane, noise: float, radius: float) -> ImageFit:
    """Return a fit whose ropes end where the depths of all pixels agree most.

    It is the same fit if all ends are best where they are.

    Parameters
    ----------
    images : RopeImages
    fit : ImageFit
    table : Plane
    noise : float
        Standard deviation of depth, metres.
    radius : float
        Metres.
    """
    chains = list(fit.nodes)
    steps = np.arange(_STEP, _REACH + 0.5 * _STEP, _STEP) * radius
    changes = [(0.0, 0.0, 0.0), *((float(step), 0.0, 0.0) for step in steps)]
    for cut in (part * radius for part in _CUTS):
        changes += [(cut, cut + float(step), slope) for slope in _SLOPES for step in steps]
    moved = False
    for number in range(len(chains)):
        for _ in range(_ROUNDS):
            nodes = chains[number]
            ways = [_change_end(nodes, *change, table, radius) for change in changes]
            stem = _count_stem_nodes(nodes, radius)
            rest = [*chains[:number], nodes[:stem], *chains[number + 1 :]]
            ends = [way[stem - 1 :] for way in ways]
            # of equal gains, as behind other strands, the first is the end as it was found
            best = int(np.argmax(images.measure_end_gains(rest, ends, fit.corrections, table, noise)))
            moved |= best > 0
            # reversed for the other end, and back in order after it
            chains[number] = np.ascontiguousarray(ways[best][::-1])
    return images.replace_nodes(fit, chains) if moved else fit


def cut_ends(images: RopeImages, fit: ImageFit, length: float, radius: float) -> ImageFit:
    """Return a fit whose ropes of a radius end a length, metres, earlier, if they are long enough."""
    chains = []
    for nodes in fit.nodes:
        s = path_length(nodes)
        start, stop = (length, s[-1] - length) if s[-1] > _MIN_REST * radius + 2.0 * length else (0.0, s[-1])
        places = np.concatenate([[start], s[(s > start) & (s < stop)], [stop]])
        chains.append(np.column_stack([np.interp(places, s, axis) for axis in nodes.T]))
    return images.replace_nodes(fit, chains)


def _change_end(nodes: Array, cut: float, added: float, slope: float, table: Plane, radius: float) -> Array:
    """Return a rope that is cut before its end, but not before its middle, and extended from there.

    Nothing carries the extension: it does not rise, and may fall until it lies on the table.

    Parameters
    ----------
    nodes : (M, 3) ndarray
    cut, added : float
        Lengths that are cut off and then added, metres.
    slope : float
        Fall per length of the extension.
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
    ahead = nodes[-1] - nodes[-min(_NODES_AHEAD, len(nodes))]
    ahead /= max(float(np.linalg.norm(ahead)), 1e-12)
    ahead -= (max(float(ahead @ normal), 0.0) + slope) * normal
    if added == 0.0 or np.linalg.norm(ahead) < slope + _MIN_AHEAD:
        return nodes
    more = nodes[-1] + np.arange(_STEP * radius, added + 1e-9, _STEP * radius)[:, None] * ahead
    above = more @ normal - offset
    low = min(radius, float(nodes[-1] @ normal) - offset)
    return np.vstack([nodes, more + np.maximum(low - above, 0.0)[:, None] * normal])


def _count_stem_nodes(nodes: Array, radius: float) -> int:
    """Return the number of nodes that all ways of an end begin with."""
    s = path_length(nodes)
    length = s[-1] - (_REACH + 1.0) * radius
    if length < 0.5 * s[-1]:
        length = 0.4 * s[-1]
    return max(int(np.searchsorted(s, length)), 2)
