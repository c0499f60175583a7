"""The closest places of axes to points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand._core import TubeQueries
from strand.geometry.curve import Curve
from strand.support.checks import Array


@dataclass(frozen=True, eq=False)
class Nearest:
    """The closest place of the axes to each of N points: of the rope whose surface is nearest.

    The place is `at(s)`: on the smooth curve of a chain that has one, else on the straight segments between
    nodes. Which rope is nearest is decided by straight segments, as for all other queries.

    Attributes
    ----------
    chain : (N,) ndarray of int64
        Number of the chain, 0 for a single one; -1 if the model has no chains.
    s : (N,) ndarray
        Arc length of the place, metres; NaN without chains.
    point : (N, 3) ndarray
        The place, world frame, metres; NaN without chains.
    distance : (N,) ndarray
        Distance from the place, metres; infinite without chains.
    """

    chain: NDArray[np.int64]
    s: Array
    point: Array
    distance: Array


def find_nearest(queries: TubeQueries, curves: Sequence[Curve | None], points: ArrayLike) -> Nearest:
    """Find the closest places of axes to points, on the curves of those that have one."""
    chain, s, place, distance = queries.nearest(points)
    given = np.asarray(points, dtype=np.float64)
    for i, curve in enumerate(curves):
        if curve is not None:
            mine = chain == i
            s[mine] = curve.closest(given[mine], s[mine])
            place[mine] = curve.place_at(s[mine])
            distance[mine] = np.linalg.norm(given[mine] - place[mine], axis=1)
    return Nearest(chain, s, place, distance)
