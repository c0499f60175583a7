"""The probability that the upper strand of a crossing really lies on top."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.ropes.doubt import Doubt
from strand.support.checks import Array

# set on random scenes
_SD_FACTOR = 3.0  # times the covariances' standard deviation, which ignores errors that both strands share
_MIN_SD = 0.05  # both radii: heights scatter by at least that
_REACH = 8.0  # radii: doubts nearer than that to a crossing count
_ORDER_WEIGHT = 0.13  # weight of doubts about the order
_RIVAL_WEIGHT = 0.35  # weight of doubts about other ways to join
_OTHERS_WEIGHT = 0.01  # weight of other doubts
_CUT_WEIGHT = 0.13  # weight of strands that cut into each other
_CUT_SD = 0.5  # both radii: strands may cut that far into each other
_BASE_DOUBT = 0.002  # doubt at each crossing
_MAX_LOG_ODDS = 50.0  # logarithm


def estimate_order_probability(
    height: Array, sd: Array, radii: Array, place: Array, doubts: Sequence[Doubt]
) -> Array:
    """Return the probabilities (K,) that the orders at crossings are right.

    Ropes do not pass through each other: a true height is at least both radii r, or at most -r. Normal errors
    of width s weigh how well the measured height h agrees with either:

        log odds = ((h + r)^2 - min(h - r, 0)^2) / (2 s^2)

    Here s is three times the standard deviation, and at least r - h. Doubts d about the order near the
    crossing make it a guess with probability 1 - exp(-d). With other doubts, and where strands cut into each
    other, the crossing does not exist with that probability.

    Parameters
    ----------
    height, sd : (K,) ndarray
        Height of the upper axis above the lower one, 0 or above, and its standard deviation, metres. NaN
        counts as half of both radii.
    radii : (K,) ndarray
        Sums of both ropes' radii, metres.
    place : (K, 3) ndarray
        Places of the crossings, metres.
    doubts : sequence of Doubt
        Those without a place count nowhere.
    """
    rise = height / radii
    with np.errstate(over="ignore", divide="ignore"):
        noise = np.hypot(_SD_FACTOR * np.where(np.isnan(sd), 0.5 * radii, sd) / radii, _MIN_SD)
        width = np.maximum(noise, 1.0 - rise)
        odds = ((rise + 1.0) ** 2 - np.minimum(rise - 1.0, 0.0) ** 2) / (2.0 * width**2)
    likely = 1.0 / (1.0 + np.exp(-np.minimum(odds, _MAX_LOG_ODDS)))
    cut = np.maximum(1.0 - rise, 0.0) ** 2 / (noise**2 + _CUT_SD**2)
    order, way = np.zeros(len(rise)), _BASE_DOUBT + _CUT_WEIGHT * cut
    for doubt in doubts:
        if doubt.place is None:
            continue
        near = np.linalg.norm(place - doubt.place, axis=1) < 0.5 * _REACH * radii
        if doubt.kind == "order":
            order += near * _ORDER_WEIGHT * doubt.amount
        else:
            way += near * (_RIVAL_WEIGHT if doubt.kind == "rival" else _OTHERS_WEIGHT) * doubt.amount
    return np.asarray((0.5 + (likely - 0.5) * np.exp(-order)) * np.exp(-way))
