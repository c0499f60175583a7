"""Bends of ropes: curvature and torsion of nodes, curves and windows, and the tightest bend."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strand.geometry.curve import Curve
from strand.support.checks import Array

STRAIGHT = 1e-9  # sine of the bend at a node; below it counts as straight
REACH = 4.0  # radii that a window reaches to either side
_SIDE = 16  # places of a window on either side
_PLACES = 4  # between two nodes, in the first search for the tightest bend
_ROUNDS = 4  # of that search, each finer
_REFINEMENT = 8.0  # times the step shrinks from round to round


def fit_window(at: Callable[[Array], Array], s: Array, reach: float) -> tuple[Array, Array, Array]:
    """Fit quintics to a line around arc lengths s (K,), and return their derivatives by arc length.

    `at` gives places of the line. Quintics reach `reach` metres to either side. The derivatives are slope,
    bend (1/m, across the slope) and jerk (1/m^2), (K, 3) each.
    """
    share = np.linspace(-1.0, 1.0, 2 * _SIDE + 1)
    fit = np.linalg.pinv(np.vander(share, 6, increasing=True))[1:4]
    around = at(s[:, None] + reach * share) - at(s)[:, None]
    slope, half, sixth = (np.einsum("j,kji->ki", row, around) / reach**k for k, row in enumerate(fit, 1))
    along = (slope * half).sum(axis=1) / np.maximum((slope * slope).sum(axis=1), 1e-300)
    return slope, 2.0 * (half - along[:, None] * slope), 6.0 * sixth


def find_window_torsion(at: Callable[[Array], Array], s: Array, reach: float) -> Array:
    """Return (K,) torsion of these quintics, 1/m; 0 where they are straight."""
    slope, bend, jerk = fit_window(at, s, reach)
    normal = np.cross(slope, bend)
    square = (normal * normal).sum(axis=1)
    bent = square > (STRAIGHT / reach) ** 2
    return np.asarray(np.where(bent, (normal * jerk).sum(axis=1) / np.where(bent, square, 1.0), 0.0))


def find_curve_torsion(curve: Curve, s: Array) -> Array:
    """Return (...,) torsion of a spline at arc lengths, 1/m; 0 where it is straight."""
    u = curve.parameter_at(s.ravel())
    first = np.clip(u.astype(np.intp), 0, len(curve.control) - 4)
    p = curve.control[first + np.arange(4)[:, None]]
    t = (u - first)[:, None]
    # derivatives of a uniform cubic B-spline
    jerk = p[3] - 3.0 * p[2] + 3.0 * p[1] - p[0]
    bend = (p[0] - 2.0 * p[1] + p[2]) + t * jerk
    slope = 0.5 * (p[2] - p[0]) + t * (p[0] - 2.0 * p[1] + p[2]) + 0.5 * t**2 * jerk
    normal = np.cross(slope, bend)
    square = (normal**2).sum(axis=1)
    straight = square <= (STRAIGHT * (slope**2).sum(axis=1)) ** 2 * (slope**2).sum(axis=1)
    found = (normal * jerk).sum(axis=1) / np.where(straight, 1.0, square)
    return np.asarray(np.where(straight, 0.0, found).reshape(s.shape))


def find_node_derivatives(path: Array, closed: bool) -> tuple[Array, Array]:
    """Return unit tangents and curvature vectors at the nodes of straight segments.

    A closed path repeats the first node at the end.
    """
    if closed:
        path = np.vstack([path[-2], path])
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    units = steps / lengths
    before, after = lengths[:-1], lengths[1:]
    # tangent of the circle through three nodes, at the middle one
    middle = (units[:-1] * after + units[1:] * before) / (before + after)
    middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-300)
    bend = 2.0 * np.diff(units, axis=0) / (before + after)
    if closed:
        return middle, bend
    if len(path) == 2:
        return np.repeat(units, 2, axis=0), np.zeros((2, 3))
    tangents = np.vstack([units[:1], middle, units[-1:]])
    return tangents, np.vstack([bend[:1], bend, bend[-1:]])


def find_node_torsion(nodes: Array, closed: bool, s: Array) -> Array:
    """Return (...,) torsion of straight segments at arc lengths, 1/m, see `Line.torsion_at`."""
    path = np.vstack([nodes[-1:], nodes, nodes[:2]]) if closed else nodes
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if len(steps) < 3:
        return np.zeros(s.shape)
    units = steps / lengths[:, None]
    normals = np.cross(units[:-1], units[1:])
    sines = np.linalg.norm(normals, axis=1)
    normals /= np.maximum(sines, 1e-300)[:, None]
    a, b = normals[:-1], normals[1:]
    angle = np.arctan2((np.cross(a, b) * units[1:-1]).sum(axis=1), (a * b).sum(axis=1))
    bent = (sines[:-1] > STRAIGHT) & (sines[1:] > STRAIGHT)
    torsion = np.where(bent, angle / lengths[1:-1], 0.0)
    ends = np.cumsum(lengths) - (lengths[0] if closed else 0.0)
    middles = ends[1:-1] - 0.5 * lengths[1:-1]
    if closed:
        return np.asarray(np.interp(s, middles, torsion, period=float(ends[-2])))
    return np.asarray(np.interp(s, middles, torsion))


def find_tightest_bend(curve: Curve, arc_length: Array) -> tuple[float, float]:
    """Return the radius and arc length of a curve's tightest bend, metres; (inf, 0) if it is straight."""
    s = np.linspace(arc_length[0], arc_length[-1], _PLACES * (len(arc_length) - 1) + 1)
    step = s[1]
    worst, bend = 0.0, -1.0
    for _ in range(_ROUNDS):
        bends = np.linalg.norm(curve.at(s)[2], axis=1)
        worst, bend = float(s[bends.argmax()]), float(bends.max())
        s = np.clip(np.linspace(worst - step, worst + step, 17), arc_length[0], arc_length[-1])
        step /= _REFINEMENT
    return (1.0 / bend, worst) if bend > 0 else (float("inf"), 0.0)
