"""Places where ropes pass over each other, or over themselves, as seen from one side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np

from strand.chain import Chain
from strand.checks import Array

# so many pieces of chains are compared, each with each
_MOST_PIECES = 4000
# bends of one strand within so many radii of arc length are no crossing
_APART = 4.0


@dataclass(frozen=True, eq=False)
class Crossing:
    """One strand over another.

    Attributes
    ----------
    place : (3,) ndarray
        In the middle between the strands, world frame, metres.
    over, under : (int, float)
        The chain's number and the arc length, metres, of the strand that is nearer, and of the other one.
    """

    place: Array
    over: tuple[int, float]
    under: tuple[int, float]


def side_seen(points: Array, viewpoints: Array) -> Array:
    """(3,) Unit vector from points to where most of the cameras stand; z if they stand all around."""
    rays = viewpoints - points.mean(axis=0)
    lengths = np.linalg.norm(rays, axis=1, keepdims=True)
    side = (rays / np.maximum(lengths, 1e-300)).sum(axis=0)
    length = float(np.linalg.norm(side))
    return np.asarray(side / length) if length > 1e-6 else np.array([0.0, 0.0, 1.0])


def crossings(chains: Sequence[Chain], towards: Array) -> list[Crossing]:
    """Find where chains cross in a plan.

    Long models are compared with fewer nodes, and may lose crossings of strands that touch twice in a row.

    Parameters
    ----------
    chains : sequence of Chain
    towards : (3,) ndarray
        Unit vector towards who looks at the plan.
    """
    every = max(ceil(sum(len(chain.points) for chain in chains) / _MOST_PIECES), 1)
    starts, ends, number, at, along = [], [], [], [], []
    for i, chain in enumerate(chains):
        kept = np.unique(np.append(np.arange(0, len(chain.points), every), len(chain.points) - 1))
        nodes, lengths = chain.points[kept], chain.arc_length[kept]
        if chain.closed:
            nodes, lengths = np.vstack([nodes, nodes[:1]]), np.append(lengths, chain.length)
        starts.append(nodes[:-1])
        ends.append(nodes[1:])
        at.append(lengths[:-1])
        along.append(np.diff(lengths))
        number.append(np.full(len(nodes) - 1, i))
    if not chains:
        return []
    start, end = np.concatenate(starts), np.concatenate(ends)
    which, from_, by = np.concatenate(number), np.concatenate(at), np.concatenate(along)
    aside = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    aside /= np.linalg.norm(aside)
    plan = np.column_stack([aside, np.cross(towards, aside)])
    origin = start.mean(axis=0)
    a, b = (start - origin) @ plan, (end - origin) @ plan
    found = []
    for k in range(len(start) - 1):
        # sides of the later pieces on which the ends of piece k lie, and theirs of it: a node that is exactly
        # on a line counts for one of the two pieces that it joins
        c, d = a[k + 1 :], b[k + 1 :]
        of_a, of_b = _cross(d - c, a[k] - c), _cross(d - c, b[k] - c)
        of_c, of_d = _cross(b[k] - a[k], c - a[k]), _cross(b[k] - a[k], d - a[k])
        met = ((of_a >= 0) != (of_b >= 0)) & ((of_c >= 0) != (of_d >= 0))
        for hit in np.flatnonzero(met).tolist():
            m = k + 1 + hit
            mine = of_a[hit] / (of_a[hit] - of_b[hit])
            theirs = of_c[hit] / (of_c[hit] - of_d[hit])
            here, there = float(from_[k] + mine * by[k]), float(from_[m] + theirs * by[m])
            chain = chains[which[k]]
            if which[k] == which[m]:
                apart = there - here
                apart = min(apart, chain.length - apart) if chain.closed else apart
                if apart < _APART * chain.radius:
                    continue
            p = start[k] + mine * (end[k] - start[k])
            q = start[m] + theirs * (end[m] - start[m])
            both = (int(which[k]), here), (int(which[m]), there)
            over, under = both if (p - q) @ towards > 0 else both[::-1]
            found.append(Crossing((p + q) / 2, over, under))
    return found


def _cross(a: Array, b: Array) -> Array:
    """Third component of the cross product of vectors in a plane."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
