"""Ends that run into the side of another chain: a branched object is no rope."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.geometry.polyline import bound_polylines, measure_gaps
from strand.reconstruction.evidence.visibility import Visibility
from strand.ropes.chain import Chain
from strand.support.checks import Array

_REACH = 1.75  # radii between a branch's end and the trunk's side, as end finding may miss an end by this
_MAX_OFFSET = 1.2  # radii: a branch points at the trunk's axis this well
_STEP = 0.25  # radii between places where the way to the trunk is checked
_DIRECTION = 8  # nodes over which the direction of an end is taken


def find_branches(
    chains: Sequence[Chain], visibility: Visibility | None = None
) -> list[tuple[int, int, Array]]:
    """Find ends that run straight into the side of another chain: ropes that only touch do not.

    Parameters
    ----------
    chains : sequence of Chain
    visibility : Visibility, optional
        An end is no branch if the views saw free space between it and the other chain.

    Returns
    -------
    list of (int, int, (3,) ndarray)
        Number of the chain that ends, of the one it ends on, and where, metres.
    """
    found: list[tuple[int, int, Array]] = []
    if len(chains) < 2:
        return found
    boxes = bound_polylines([chain.points for chain in chains])
    radii = np.array([chain.radius for chain in chains])
    for number, chain in enumerate(chains):
        for points in () if chain.closed else (chain.points, chain.points[::-1]):
            r = chain.radius
            out = points[0] - points[min(_DIRECTION, len(points) - 1)]
            out = out / np.linalg.norm(out)
            near = measure_gaps(boxes, points[0]) < radii + _REACH * r
            near[number] = False
            for other in np.flatnonzero(near).tolist():
                trunk = chains[other]
                reach = trunk.radius + _REACH * r
                ahead = points[0] + np.arange(0.0, reach, _STEP * r)[:, None] * out
                nearest = np.sqrt(_core.find_squared_distances(ahead, trunk.points))
                if nearest[0] >= reach or nearest.min() >= _MAX_OFFSET * r:
                    continue
                (place,) = _core.find_nearest(ahead[[nearest.argmin()]], trunk.points).tolist()
                if not (trunk.closed or 2.0 * r < trunk.arc_length[place] < trunk.length - 2.0 * r):
                    continue
                between = ahead[: nearest.argmin()][nearest[: nearest.argmin()] > trunk.radius]
                if visibility is None or not visibility.free(between, r).any():
                    found.append((number, other, trunk.points[place]))
    return found
