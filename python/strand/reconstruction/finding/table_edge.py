"""Ropes that hang over the edge of the table that they were found on: strand drops what is below it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.geometry.plane import Plane
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.depth_image import list_pixels
from strand.views.view import View

_REACH = 6.0  # radii around an end: points there count
_BELOW = 1.5  # radii below the table: points there are beyond its edge
_OWN = 2.0  # radii around ropes: points there are theirs
_DEVIATIONS = 6.0  # standard deviations of the table's heights: points that far below are beyond its edge
_DEVIATION_OF_MEDIAN = 1.5  # standard deviation over the median of absolute heights, rounded up
_MIN_POINTS = 10  # beyond the edge: with fewer an end is not doubted
_DOUBT = 2.0  # amount of doubt of an end


def doubt_ends_at_edge(
    chains: Sequence[Chain], views: Sequence[View], tables: Sequence[Plane | None]
) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Doubt ends near which a view shows points below the table: the rope may go on there.

    Parameters
    ----------
    chains : sequence of Chain
    views : sequence of View
        Not cropped.
    tables : sequence of Plane or None
        Each view's table, world frame; None where it shows none.

    Returns
    -------
    list of (Doubt, tuple of int)
        Each with the number of its chain.
    """
    found: list[tuple[Doubt, tuple[int, ...]]] = []
    lines = np.concatenate([chain.points for chain in chains]) if chains else np.zeros((0, 3))
    for number, chain in enumerate(chains):
        for end in () if chain.closed else (chain.points[0], chain.points[-1]):
            if any(
                _shows_below(view, table, end, chain.radius, lines)
                for view, table in zip(views, tables, strict=True)
                if table is not None
            ):
                reason = "something is seen below the table's edge beside this end: the rope may go on there"
                found.append((Doubt("cut end", _DOUBT, "where a rope ends", reason, end), (number,)))
    return found


def _shows_below(view: View, table: Plane, end: Array, radius: float, lines: Array) -> bool:
    """Tell whether points near an end lie clearly below a table, off the lines (M, 3) of all ropes."""
    near = _select_near(view, end, _REACH * radius)
    heights = table.measure_heights(near)
    # most ends have a table all around
    if np.count_nonzero(heights < -_BELOW * radius) < _MIN_POINTS:
        return False
    heights = heights[_core.find_squared_distances(near, lines) > (_OWN * radius) ** 2]
    return int(np.count_nonzero(heights < -find_depth(heights, radius))) >= _MIN_POINTS


def find_depth(heights: Array, radius: float) -> float:
    """Return how deep points beyond a table's edge lie under its plane at least, metres.

    Parameters
    ----------
    heights : (N,) ndarray
        Of points over the plane, those of the table among them, metres.
    radius : float
        Of the ropes, metres.
    """
    on_table = np.abs(heights[np.abs(heights) < _BELOW * radius])
    scatter = _DEVIATION_OF_MEDIAN * _core.find_median(on_table) if len(on_table) else 0.0
    return float(max(_BELOW * radius, _DEVIATIONS * scatter))


def _select_near(view: View, place: Array, reach: float) -> Array:
    """(N, 3) Return the points of a view within reach of a place, metres, world frame."""
    if view.image is None:
        points = view.world_points
    else:
        image, depth = view.image, view.image.depth
        z = float((place - view.pose[:3, 3]) @ view.pose[:3, 2])
        if z <= reach:
            return np.empty((0, 3))
        column, row = image.project(place[None])[0]
        across, down = (length * reach / (z - reach) for length in image.camera.focal)
        height, width = depth.shape
        top, left = (max(int(low), 0) for low in (row - down, column - across))
        bottom, right = min(int(row + down) + 1, height), min(int(column + across) + 1, width)
        window = depth[top : max(bottom, top), left : max(right, left)]
        rows, columns = list_pixels(window > 0)
        points = image.lift(rows + top, columns + left, window[rows, columns])
    return np.compress(measure_lengths(points - place) < reach, points, axis=0)
