"""Prepare arcs for joining: cut them at wrong turns, drop duplicates, turn stubs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.config import Linking
from strand.geometry.polyline import end_direction, find_runs, path_length
from strand.reconstruction.tubes.bridges import DIRECTION_SPAN
from strand.support.checks import Array

_MAX_DUPLICATE = 6.0  # radii: longer arcs are no duplicates
_BESIDE = 1.75  # radii: strands in contact are farther from each other than this
_OWN = 4.0  # radii of arc length: nodes of the same arc this near along it are no other strand
_MAX_STUB = 2.5  # radii: longer arcs are no stubs
_MAX_AIM = 0.5  # radians: an arc points at a stub within this angle
_AIM_RANGE = (1.2, 6.0)  # radii: gap between a stub's middle and the end that points at it


def cut_at_contacts(arcs: Sequence[Array], radius: float, config: Linking, back: float = 0.0) -> list[Array]:
    """Cut arcs where another arc's end lies inside them, as a trace took a wrong turn there.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The ropes' radius, metres.
    config : Linking
    back : float
        Length up to which the end itself is cut back while it is inside the other strand, radii.

    Returns
    -------
    list of (K, 3) ndarray
        The arcs without the nodes around contacts. Parts of fewer than three nodes are dropped.
    """
    kept = [np.ones(len(arc), dtype=bool) for arc in arcs]
    half = config.contact_gap * radius
    for end, j, nearest in _core.find_contacts(arcs, config.contact * radius, _OWN * radius):
        arc, other = arcs[end // 2], arcs[j]
        s = path_length(other)
        if half < s[nearest] < s[-1] - half:
            kept[j] &= np.abs(s - s[nearest]) > half
            from_first = path_length(arc)
            from_end = from_first[-1] - from_first if end % 2 else from_first
            kept[end // 2] &= ~_find_merged(arc, from_end, other, end // 2 == j, radius, back)
    parts = []
    for arc, keep in zip(arcs, kept, strict=True):
        parts += [arc[a:b] for a, b in find_runs(keep) if b - a >= 3]
    return parts


def _find_merged(
    arc: Array, from_end: Array, other: Array, same: bool, radius: float, back: float
) -> np.ndarray:
    """Return which nodes up to `back` radii from an arc's end have not yet left another strand."""
    if back <= 0:
        return np.zeros(len(arc), dtype=bool)
    rows = from_end < back * radius
    here = from_end[rows]
    distance = np.linalg.norm(arc[rows, None] - other[None], axis=2)
    if same:
        distance[np.abs(here[:, None] - from_end[None]) < _OWN * radius + here[:, None]] = np.inf
    left = here[distance.min(axis=1) > _BESIDE * radius]
    return np.asarray(from_end < min(float(left.min()) if len(left) else np.inf, back * radius))


def drop_duplicates(arcs: Sequence[Array], radius: float) -> list[Array]:
    """Drop short arcs that run inside longer ones: two strands are at least two radii apart."""
    lengths = [path_length(arc)[-1] for arc in arcs]
    kept = []
    for arc, length in zip(arcs, lengths, strict=True):
        longer = [other for other, its in zip(arcs, lengths, strict=True) if its > length]
        if length < _MAX_DUPLICATE * radius and longer:
            distance = np.sqrt(_core.find_squared_distances(arc, np.concatenate(longer)))
            if np.median(distance) < _BESIDE * radius:
                continue
        kept.append(arc)
    return kept


def turn_stubs(arcs: Sequence[Array], radius: float) -> list[Array]:
    """Turn stubs into the direction of the arc that points at them.

    A rope seen beyond a crossing near its end is about as long as wide, so that a tube fitted to it may lie
    across. It is turned to the circle from the other arc's end to the stub's middle.
    """
    lengths = [path_length(arc)[-1] for arc in arcs]
    ends = [
        (nodes[-1], end_direction(nodes, 0.0, DIRECTION_SPAN * radius))
        for arc, length in zip(arcs, lengths, strict=True)
        if length >= _MAX_STUB * radius
        for nodes in (arc[::-1], arc)
    ]
    turned = []
    for arc, length in zip(arcs, lengths, strict=True):
        middle = arc[len(arc) // 2]
        best, least = None, _MAX_AIM
        for end, leave in ends if length < _MAX_STUB * radius else []:
            step = middle - end
            gap = float(np.linalg.norm(step))
            if not _AIM_RANGE[0] * radius < gap < _AIM_RANGE[1] * radius:
                continue
            straight = step / gap
            angle = float(np.arccos(np.clip(leave @ straight, -1.0, 1.0)))
            if angle < least:
                best, least = 2.0 * (leave @ straight) * straight - leave, angle
        own = end_direction(arc, 0.0, length)
        if best is not None and abs(own @ best) < np.cos(_MAX_AIM):
            arc = middle + np.linspace(-0.5, 0.5, len(arc))[:, None] * length * best
        turned.append(arc)
    return turned
