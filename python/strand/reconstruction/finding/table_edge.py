"""Ropes that hang over the edge of the table that they were found on: what is below it was left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.reconstruction.images.rope_image import RopeImage
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.view import View

# points so near an end are looked at, radii; below the table by so much, radii and standard deviations of
# its depths, they are beyond its edge; fewest of them that say so; how much doubt that is
_AROUND, _BELOW, _CLEARLY, _FEWEST, _GOES_ON = 6.0, 1.5, 6.0, 10, 1.5


def over_the_edge(
    chains: Sequence[Chain], views: Sequence[View], tables: Sequence[tuple[Array, float] | None]
) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Doubt ends near which something is seen below the table: the rope may go on there.

    Parameters
    ----------
    chains : sequence of Chain
    views : sequence of View
        With all that they saw.
    tables : sequence of ((3,) ndarray, float) or None
        Unit normal n of the table in each view, world frame, and n.x, metres; None where it shows none.

    Returns
    -------
    list of (Doubt, tuple of int)
        Each with the number of the chain that it is about.
    """
    found: list[tuple[Doubt, tuple[int, ...]]] = []
    for number, chain in enumerate(chains):
        for end in () if chain.closed else (chain.points[0], chain.points[-1]):
            if any(
                _below(view, table, end, chain.radius) >= _FEWEST
                for view, table in zip(views, tables, strict=True)
                if table is not None
            ):
                reason = "something is seen below the table's edge beside this end: the rope may go on there"
                found.append((Doubt("end", _GOES_ON, "where a rope ends", reason, end), (number,)))
    return found


def _below(view: View, table: tuple[Array, float], end: Array, radius: float) -> int:
    """How many points near an end lie clearly below a table."""
    points = _near(view, end, _AROUND * radius)
    heights = points @ table[0] - table[1]
    on_table = np.abs(heights[np.abs(heights) < _BELOW * radius])
    scatter = 1.5 * float(np.median(on_table)) if len(on_table) else 0.0
    return int(np.count_nonzero(heights < -max(_BELOW * radius, _CLEARLY * scatter)))


def _near(view: View, place: Array, reach: float) -> Array:
    """(N, 3) The points of a view within reach of a place, world frame."""
    if view.image is None:
        points = view.world_points
    else:
        depth, focal, centre = view.image.depth, view.image.focal, view.image.centre
        image = RopeImage(depth, depth > 0, focal, centre, view.pose)
        z = float((place - view.pose[:3, 3]) @ view.pose[:3, 2])
        if z <= reach:
            return np.empty((0, 3))
        column, row = image.projected(place[None])[0]
        across, down = (length * reach / (z - reach) for length in focal)
        height, width = depth.shape
        top, left = (max(int(low), 0) for low in (row - down, column - across))
        bottom, right = min(int(row + down) + 1, height), min(int(column + across) + 1, width)
        window = depth[top : max(bottom, top), left : max(right, left)]
        rows, columns = np.nonzero(window > 0)
        points = image.world(rows + top, columns + left, window[rows, columns])
    return np.asarray(points[np.linalg.norm(points - place, axis=1) < reach])
