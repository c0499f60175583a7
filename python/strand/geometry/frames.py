"""Unit vectors, and directions across a line that are carried along it without twist."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from strand.support.checks import Array, check_small_array


def check_direction(name: str, value: ArrayLike) -> Array:
    """Return an argument (3,) of any length but zero as a unit vector."""
    given = check_small_array(name, value, (3,))
    largest = float(np.abs(given).max())
    if largest == 0.0:
        raise ValueError(f"{name}: expected a vector that is not zero, got [0, 0, 0]")
    scaled = given / largest
    return np.asarray(scaled / np.linalg.norm(scaled))


def choose_side(tangent: Array) -> Array:
    """Return the unit vector (3,) across a tangent nearest to z, or to x for a tangent along z."""
    up = np.array([0.0, 0.0, 1.0]) if abs(tangent[2]) < 1.0 - 1e-6 else np.array([1.0, 0.0, 0.0])
    across = up - (up @ tangent) * tangent
    return np.asarray(across / np.linalg.norm(across))


def fill_lost_tangents(path: Array, tangents: Array, closed: bool) -> Array:
    """Return tangents (M, 3); nodes that turn back on themselves get the direction of the step before.

    A closed path repeats the first node at the end.
    """
    lost = np.linalg.norm(tangents, axis=1) < 0.5
    if not lost.any():
        return tangents
    steps = np.diff(path, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    before = np.roll(steps, 1, axis=0) if closed else np.vstack([steps[:1], steps])
    return np.where(lost[:, None], before, tangents)


def carry_along_nodes(nodes: Array, tangents: Array, start: Array) -> Array:
    """Return (M, 3) directions across the tangents at nodes, carried from the one at the first node."""
    across = [start]
    for i in range(len(nodes) - 1):
        across.append(carry_directions(across[-1], nodes[i], tangents[i], nodes[i + 1], tangents[i + 1]))
    return np.array(across)


def carry_directions(across: Array, here: Array, tangent: Array, ahead: Array, next_tangent: Array) -> Array:
    """Carry directions (..., 3) from here ahead by double reflection (Wang et al. 2008, table I)."""
    across, tangent = (_reflect(one, ahead - here) for one in (across, tangent))
    across = _reflect(across, next_tangent - tangent)
    across = across - _dot(across, next_tangent) * next_tangent
    return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))


def _reflect(direction: Array, normal: Array) -> Array:
    """Mirror directions (..., 3) in the planes across normals of any length."""
    square = _dot(normal, normal)
    return np.asarray(direction - 2.0 * _dot(direction, normal) / np.where(square == 0, 1.0, square) * normal)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray((a * b).sum(axis=-1, keepdims=True))
