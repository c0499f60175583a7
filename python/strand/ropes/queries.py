"""What queries against tubes answer: `Model` asks them, the compiled module works them out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array


@dataclass(frozen=True, eq=False)
class RayHits:
    """For each of N rays, where it first meets a tube.

    Attributes
    ----------
    distance : (N,) ndarray
        Along the ray, metres, however long its direction is; infinite if it meets none, 0 if it starts in
        one.
    chain : (N,) ndarray of int64
        The chain's number; -1 if there is none.
    s : (N,) ndarray
        Arc length of the foot point of the place that is met, metres; NaN if there is none.
    normal : (N, 3) ndarray
        Unit vectors out of the tube; NaN if there is none.
    """

    distance: Array
    chain: NDArray[np.int64]
    s: Array
    normal: Array


@dataclass(frozen=True, eq=False)
class SweepHits:
    """For each of N bodies that move, when it touches a tube and how near it comes.

    Attributes
    ----------
    time : (N,) ndarray
        The first contact, as a share of the way, from 0 to 1; infinite if there is none, 0 if it starts with
        one.
    clearance : (N,) ndarray
        The least, over the whole way, of the body's distance from an axis minus that tube's radius, metres.
        It is negative where the body would be in a tube, and as low as can be where an axis is in the body.
        Infinite if the model has no chains.
    chain : (N,) ndarray of int64
        The number of the chain that is touched first, or, without contact, that the body comes nearest to;
        -1 if the model has none.
    s : (N,) ndarray
        Arc length of the foot point there, metres; NaN without chains.
    """

    time: Array
    clearance: Array
    chain: NDArray[np.int64]
    s: Array
