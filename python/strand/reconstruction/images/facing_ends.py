"""Ends of ropes that point at each other: a mask may have lost what joins them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strand.geometry.polyline import path_length
from strand.ropes.doubt import Doubt
from strand.support.checks import Array

_MAX_GAP = 18.0  # radii: ends that are farther from each other are ends of two ropes
_FULL_DOUBT_GAP = 13.0  # radii: nearer ends may belong together
_FROM_END = 0.5  # radii from an end: the direction is taken from here
_HEADING = 4.0  # radii farther along the rope: to here
_NO_DOUBT_COSINE = -0.3  # between an end's direction and the way to the other end: ends point past each other
_FULL_DOUBT_COSINE = 0.7  # the same: ends point at each other
_DOUBT = 0.35  # amount of full doubt


def doubt_facing_ends(chains: Sequence[Array], radius: float) -> Iterator[Doubt]:
    """Doubt ends of two ropes, (M, 3) nodes each, that point at each other: they may be one rope."""
    ways = [(number, way) for number, nodes in enumerate(chains) for way in (nodes, nodes[::-1])]
    for k, (number, way) in enumerate(ways):
        for other, other_way in ways[k + 1 :]:
            end, gap = way[0], other_way[0] - way[0]
            length = float(np.linalg.norm(gap))
            if other == number or not 0.0 < length < _MAX_GAP * radius:
                continue
            heading, back = _find_heading(way, radius), _find_heading(other_way, radius)
            cosine = min(float(heading @ gap), float(-back @ gap)) / length
            share = (cosine - _NO_DOUBT_COSINE) / (_FULL_DOUBT_COSINE - _NO_DOUBT_COSINE)
            share = min(share, 1.0) * min((_MAX_GAP - length / radius) / (_MAX_GAP - _FULL_DOUBT_GAP), 1.0)
            reason = (
                f"an end of another rope points at it, {length * 1e3:.0f} mm away; "
                "the mask may have lost what joins them"
            )
            yield Doubt("end", _DOUBT * max(share, 0.0), "where the rope ends", reason, end)


def _find_heading(nodes: Array, radius: float) -> Array:
    """(3,) Return the unit direction in which a rope leaves its first node."""
    from_end = path_length(nodes)
    places = np.array([_FROM_END, _FROM_END + _HEADING]) * radius
    first, last = np.stack([np.interp(places, from_end, axis) for axis in nodes.T], axis=1)
    return np.asarray((first - last) / max(float(np.linalg.norm(first - last)), np.finfo(float).tiny))
