"""Results of geometry queries, which `Model` asks and the compiled module answers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array


@dataclass(frozen=True, eq=False)
class RayHits:
    """First hits of N rays on the tubes.

    Attributes
    ----------
    distance : (N,) ndarray
        Along the ray, metres, whatever the length of its direction; infinite without a hit, 0 if it starts
        in a tube.
    chain : (N,) ndarray of int64
        Number of the chain; -1 without a hit.
    s : (N,) ndarray
        Arc length of the foot point on the axis, metres; NaN without a hit.
    normal : (N, 3) ndarray
        Unit vector out of the tube; NaN without a hit. A ray that starts in a tube has the normal of the
        nearest place of the axis.
    """

    distance: Array
    chain: NDArray[np.int64]
    s: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class SweepHits:
    """First contacts of N moving bodies with the tubes, and their least distances.

    Attributes
    ----------
    time : (N,) ndarray
        First contact as a fraction of the way, 0 to 1; infinite without contact, 0 if it starts with one.
    clearance : (N,) ndarray
        Least distance of the body from an axis minus that tube's radius over the whole way, metres. It is
        negative where the body would enter a tube. Infinite if the model has no chains.
    chain : (N,) ndarray of int64
        Number of the chain that the body touches first, or without contact comes nearest to; -1 if the model
        has no chains.
    s : (N,) ndarray
        Arc length of the foot point there, metres; NaN without chains.
    """

    time: Array
    clearance: Array
    chain: NDArray[np.int64]
    s: Array
