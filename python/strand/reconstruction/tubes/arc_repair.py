"""Arcs made fit for joining: parted where a trace took a wrong turn, rid of duplicates, stubs turned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.config import Linking
from strand.geometry.polyline import end_direction, find_runs, path_length
from strand.support.checks import Array

# arcs shorter than this may be duplicates of others that they are nearer to than strands in contact, in radii
_DUPLICATE, _BESIDE = 6.0, 1.75
# arcs shorter than this are stubs, in radii; an arc points at one within this angle, radians
_STUB, _AIM = 2.5, 0.5


def part_at_contacts(arcs: Sequence[Array], radius: float, config: Linking, back: float = 0.0) -> list[Array]:
    """Cut arcs where another's end lies inside them.

    Two strands cannot be in one place, so a trace took a wrong turn there.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The ropes' radius, metres.
    config : Linking
    back : float
        How far such an end is cut back too, as long as it is that near, in radii.

    Returns
    -------
    list of (K, 3) ndarray
        The arcs, without the nodes around contacts; parts of fewer than three nodes are left out.
    """
    lengths = [path_length(arc) for arc in arcs]
    kept = [np.ones(len(arc), dtype=bool) for arc in arcs]
    half = config.contact_gap * radius
    low, high = (np.array([corner(arc, axis=0) for arc in arcs]) for corner in (np.min, np.max))
    for i, arc in enumerate(arcs):
        for end, place in ((arc[0], 0.0), (arc[-1], lengths[i][-1])):
            # arcs whose box is farther away have no contact there
            beyond = np.maximum(np.maximum(low - end, end - high), 0.0)
            for j in np.flatnonzero((beyond**2).sum(axis=1) <= (config.contact * radius) ** 2).tolist():
                other = arcs[j]
                distance = np.linalg.norm(other - end, axis=1)
                if i == j:
                    distance[np.abs(lengths[j] - place) < 4.0 * radius] = np.inf
                nearest = int(distance.argmin())
                s = lengths[j]
                inside = half < s[nearest] < s[-1] - half
                if inside and distance[nearest] < config.contact * radius:
                    kept[j] &= np.abs(s - s[nearest]) > half
                    kept[i] &= ~_merged(arc, np.abs(lengths[i] - place), other, i == j, radius, back)
    parts = []
    for arc, keep in zip(arcs, kept, strict=True):
        parts += [arc[a:b] for a, b in find_runs(keep) if b - a >= 3]
    return parts


def _merged(arc: Array, from_end: Array, other: Array, same: bool, radius: float, back: float) -> np.ndarray:
    """(M,) Nodes up to `back` radii from an arc's end that have not yet left another strand."""
    if back <= 0:
        return np.zeros(len(arc), dtype=bool)
    # what is farther back stays
    rows = from_end < back * radius
    here = from_end[rows]
    apart = np.linalg.norm(arc[rows, None] - other[None], axis=2)
    if same:
        apart[np.abs(here[:, None] - from_end[None]) < 4.0 * radius + here[:, None]] = np.inf
    left = here[apart.min(axis=1) > 1.75 * radius]
    return np.asarray(from_end < min(float(left.min()) if len(left) else np.inf, back * radius))


def without_duplicates(arcs: Sequence[Array], radius: float) -> list[Array]:
    """Leave out short arcs that run inside longer ones: two strands are at least two radii apart.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The ropes' radius, metres.

    Returns
    -------
    list of (M, 3) ndarray
    """
    lengths = [path_length(arc)[-1] for arc in arcs]
    kept = []
    for arc, length in zip(arcs, lengths, strict=True):
        longer = [other for other, its in zip(arcs, lengths, strict=True) if its > length]
        if length < _DUPLICATE * radius and longer:
            apart = np.sqrt(_core.squared_distances(arc, np.concatenate(longer)))
            if np.median(apart) < _BESIDE * radius:
                continue
        kept.append(arc)
    return kept


def aimed(arcs: Sequence[Array], radius: float) -> list[Array]:
    """Turn stubs, whose own direction is no better than chance, into that of the arc that leads to them.

    What is seen of a rope beyond a crossing near its end is about as long as wide; a tube fitted to it may
    lie across. The arc that points at it says how it runs: along the circle from its end to the stub's
    middle.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The ropes' radius, metres.

    Returns
    -------
    list of (M, 3) ndarray
        The arcs in their order, stubs turned.
    """
    lengths = [path_length(arc)[-1] for arc in arcs]
    ends = [
        (nodes[-1], end_direction(nodes, 0.0, 1.5 * radius))
        for arc, length in zip(arcs, lengths, strict=True)
        if length >= _STUB * radius
        for nodes in (arc[::-1], arc)
    ]
    turned = []
    for arc, length in zip(arcs, lengths, strict=True):
        middle = arc[len(arc) // 2]
        best, least = None, _AIM
        for end, leave in ends if length < _STUB * radius else []:
            step = middle - end
            gap = float(np.linalg.norm(step))
            if not 1.2 * radius < gap < 6.0 * radius:
                continue
            straight = step / gap
            angle = float(np.arccos(np.clip(leave @ straight, -1.0, 1.0)))
            if angle < least:
                best, least = 2.0 * (leave @ straight) * straight - leave, angle
        own = end_direction(arc, 0.0, length)
        if best is not None and abs(own @ best) < np.cos(_AIM):
            arc = middle + np.linspace(-0.5, 0.5, len(arc))[:, None] * length * best
        turned.append(arc)
    return turned
