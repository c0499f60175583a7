"""How likely it is that the strand that seems to lie on top at a crossing does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.ropes.doubt import Doubt
from strand.support.checks import Array

# set on random scenes: how many times wider heights scatter than covariances say, which leave out what both
# strands share; the least that they do, of both radii; how far doubts reach, in radii; what doubts count for,
# of the order, of which way ropes run, and others; what strands count for that cut into each other; and the
# doubt that is always there
_WIDER, _LEAST = 3.0, 0.05
_REACH = 8.0
_ORDER, _WAY, _OTHERS = 0.13, 0.35, 0.01
_CUT, _SOFT = 0.13, 0.5
_ALWAYS = 0.002
# odds beyond e to this are the same
_MOST = 50.0


def estimate_order_probability(
    height: Array, sd: Array, radii: Array, place: Array, doubts: Sequence[Doubt]
) -> Array:
    """Return how likely the orders at crossings are right.

    Ropes do not pass through each other: a true height is at least both radii r, or at most -r. How well the
    height h of the chains agrees with either is weighed by normal errors of width s:

        log odds = ((h + r)^2 - min(h - r, 0)^2) / (2 s^2)

    where s is three times the standard deviation w, and not less than r - h. Doubts d near the crossing that
    are about the order make it a guess with probability 1 - exp(-d). With the others, and with the square of
    r - h where strands cut into each other, there is no such crossing with probability 1 - exp(-d).

    Parameters
    ----------
    height, sd : (K,) ndarray
        Height of the upper axis above the lower one, 0 or above, and its standard deviation, metres. Where
        that is NaN it counts as half of both radii.
    radii : (K,) ndarray
        Sums of both ropes' radii, metres.
    place : (K, 3) ndarray
        Where, metres.
    doubts : sequence of Doubt
        Those without a place count nowhere.

    Returns
    -------
    (K,) ndarray
        From 0 to 1.
    """
    rise = height / radii
    with np.errstate(over="ignore", divide="ignore"):
        noise = np.hypot(_WIDER * np.where(np.isnan(sd), 0.5 * radii, sd) / radii, _LEAST)
        width = np.maximum(noise, 1.0 - rise)
        odds = ((rise + 1.0) ** 2 - np.minimum(rise - 1.0, 0.0) ** 2) / (2.0 * width**2)
    likely = 1.0 / (1.0 + np.exp(-np.minimum(odds, _MOST)))
    cut = np.maximum(1.0 - rise, 0.0) ** 2 / (noise**2 + _SOFT**2)
    order, way = np.zeros(len(rise)), _ALWAYS + _CUT * cut
    for doubt in doubts:
        if doubt.place is None:
            continue
        near = np.linalg.norm(place - doubt.place, axis=1) < 0.5 * _REACH * radii
        if doubt.kind == "order":
            order += near * _ORDER * doubt.amount
        else:
            way += near * (_WAY if doubt.kind == "rival" else _OTHERS) * doubt.amount
    return np.asarray((0.5 + (likely - 0.5) * np.exp(-order)) * np.exp(-way))
