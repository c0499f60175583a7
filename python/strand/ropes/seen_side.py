"""The side that cameras look from, and checks of a model's `up` and `table`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from strand.geometry.frames import check_direction
from strand.geometry.plane import Plane
from strand.support.checks import Array, check_number, check_sequence, check_small_array, freeze_array

USUAL_UP: Array = np.frombuffer(np.array([0.0, 0.0, 1.0]).tobytes())
"""(3,) Up where nothing says which way it is: z of the world frame. Nobody can make it writeable."""

_MIN_SIDE_LENGTH = 1e-6  # of the sum of unit vectors; cameras all around give less
_MAX_LENGTH_ERROR = 1e-12  # of a vector that counts as a unit vector


def find_seen_side(points: Array, viewpoints: Array) -> Array:
    """Return the (3,) unit vector from points towards most of the cameras; z if these are all around."""
    rays = viewpoints - points.mean(axis=0)
    lengths = np.linalg.norm(rays, axis=1, keepdims=True)
    side = (rays / np.maximum(lengths, 1e-300)).sum(axis=0)
    length = float(np.linalg.norm(side))
    return np.asarray(side / length) if length > _MIN_SIDE_LENGTH else USUAL_UP


def check_up(name: str, value: ArrayLike) -> Array:
    """Return an argument (3,) of any length but zero as a read-only unit vector.

    A unit vector keeps its bits, so that files keep them too.
    """
    if value is USUAL_UP:
        return USUAL_UP
    given = check_small_array(name, value, (3,))
    if abs(float(np.linalg.norm(given)) - 1.0) > _MAX_LENGTH_ERROR:
        given = check_direction(name, value)
    return freeze_array(given)


def check_table(name: str, value: tuple[ArrayLike, float]) -> Plane:
    """Return an argument, a normal of any length but zero and an offset n.x, as a plane."""
    given = check_sequence(name, value, "a normal and an offset")
    if len(given) != 2:
        raise ValueError(f"{name}: expected a normal and an offset, got {len(given)} values")
    normal = check_up(f"{name}[0]", given[0])
    length = float(np.linalg.norm(check_small_array(f"{name}[0]", given[0], (3,))))
    offset = check_number(f"{name}[1]", given[1])
    return Plane(normal, offset if abs(length - 1.0) <= _MAX_LENGTH_ERROR else offset / length)
