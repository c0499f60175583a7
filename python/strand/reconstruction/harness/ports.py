"""Ports: the ends of arcs at hubs, with direction, width and height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strand.reconstruction.harness.lines import Lines
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_NEAR = 1.2  # distance from the hub where an arc is its own, half widths
_TELLING = 5.0  # stretch from there on that tells its direction, half widths
_FEW = 3  # cells that tell a direction at least
_BENT = 7  # cells that tell a bend at least
_FLAT = 0.7  # height of wires side by side over the table at most, widths
_CLOSE = 3.0  # distance up to which heights are near, half widths
_REST = (4.0, 12.0)  # distances between which heights are those of the arc itself, half widths


@dataclass(frozen=True, eq=False)
class Port:
    """An arc's end at a hub. Lengths are in cells unless noted.

    Attributes
    ----------
    arc, end : int
        The arc's number, and 0 for its first or 1 for its last cell.
    place, direction : (2,) ndarray
        Where the arc enters the hub, and the unit vector along it there, away from the hub.
    mean_direction : (2,) ndarray
        The same over all of the stretch near the hub.
    curvature : (2,) ndarray
        Change of the direction there along the arc, per cell.
    half_width : float
    thickness : float
        How high the strand is, metres: at most as its width, or as its surface over the table.
    depth : float
        Depth of its axis below its surface, metres.
    height : float
        Of the surface, continued to the hub, metres.
    near, rest : float
        Height of the surface near the hub, and farther along the arc, metres.
    scatter : float
        Standard deviation of the heights near the hub about a line, metres.
    is_flat : bool
        Whether wires lie side by side there: wide and low.
    """

    arc: int
    end: int
    place: Array
    direction: Array
    mean_direction: Array
    curvature: Array
    half_width: float
    thickness: float
    depth: float
    height: float
    near: float
    rest: float
    scatter: float
    is_flat: bool


def measure_port(arc: int, end: int, lines: Lines, drawn: SurfaceMap, floor: float | None) -> Port:
    """Measure an arc's end at its hub; `floor` is the height of a table, metres."""
    cells = lines.arcs[arc].from_end(end)
    hub = lines.hubs[lines.arcs[arc].hubs[end]]
    along = measure_along(cells)
    widths = drawn.sample_widths(cells[len(cells) // 4 :] if len(cells) > 8 else cells)
    half_width = max(float(np.median(widths)), 1.0)
    # a thin strand is its own only outside the thick one that it meets
    entry = max(_NEAR * half_width, float(drawn.sample_widths(hub[None])[0]))
    used = (along > entry) & (along < entry + _TELLING * half_width)
    if used.sum() <= _FEW:
        used = np.ones(len(cells), dtype=bool)
    stretch, heights = cells[used], drawn.sample_heights(cells[used])
    mean_direction = _find_direction(stretch, stretch.mean(axis=0) - hub)
    place, direction, curvature = stretch.mean(axis=0), mean_direction, np.zeros(2)
    if len(stretch) > _BENT:
        fitted = np.polynomial.polynomial.polyfit(along[used] - entry, stretch, 2)
        place, direction = fitted[0], fitted[1] / max(float(np.linalg.norm(fitted[1])), 1e-9)
        curvature = 2.0 * fitted[2]
    height, scatter = float(np.median(heights)), float(heights.std())
    if len(stretch) > _BENT:
        line = np.polynomial.polynomial.polyfit(along[used], heights, 1)
        height = float(line[0])
        scatter = float((heights - np.polynomial.polynomial.polyval(along[used], line)).std())
    close = along < _CLOSE * half_width
    rest = (along > _REST[0] * half_width) & (along < _REST[1] * half_width)
    near = float(np.median(drawn.sample_heights(cells[close] if close.any() else stretch)))
    own = float(np.median(drawn.sample_heights(cells[rest] if rest.any() else stretch)))
    width = (1.0 + drawn.ridge) * drawn.cell * half_width
    is_flat = floor is not None and own - floor < _FLAT * width
    thickness = width if floor is None else min(width, max(own - floor, drawn.cell))
    depth = thickness * drawn.ridge / (1.0 + drawn.ridge)
    directions = direction, mean_direction, curvature
    return Port(
        arc, end, place, *directions, half_width, thickness, depth, height, near, own, scatter, is_flat
    )


def measure_along(cells: Array) -> Array:
    """Return the arc length of each cell from the first one, cells."""
    steps = np.linalg.norm(np.diff(cells, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def measure_angle(some: Array, other: Array) -> float:
    """Return the angle between two unit vectors, radians."""
    return float(np.arccos(np.clip(some @ other, -1.0, 1.0)))


def _find_direction(cells: Array, outward: Array) -> Array:
    """Return the unit vector along a stretch of cells, away from the hub."""
    if len(cells) < 2:
        return np.asarray(outward / max(float(np.linalg.norm(outward)), 1e-9))
    axis = np.linalg.svd(cells - cells.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(axis if axis @ (cells[-1] - cells[0]) >= 0.0 else -axis)
