"""The probability that a crossing is real, and that its upper strand really lies on top."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from strand.ropes.doubt import Doubt
from strand.ropes.posterior import load_posterior
from strand.support.checks import Array

_SD_FACTOR = 3.0  # times the covariances' standard deviation, which ignores errors that both strands share
_MIN_SD = 0.05  # both radii: heights scatter by at least that
_REACH = 8.0  # radii: doubts nearer than that to a crossing count
_STEEPNESS = 4.0  # a doubt of a quarter counts as 1 - 1/e of a certain one
_MAX_LOG_ODDS = 8.0  # logarithm: surer heights count no more
_MIN_SHARE = 0.02  # of a confidence: surer answers, right or wrong, count no more
_USUAL_ODDS = 2.0  # logarithm, where the confidence is not known
_MAX_CUT = 1.0  # both radii: strands that cut deeper into each other count no more
_FLAT_ANGLE = 0.5  # radians: strands that cross at less may only touch


def estimate_order_probability(evidence: Mapping[str, ArrayLike], confidence: float) -> Array:
    """Return the probabilities (K,) that crossings are real and their orders right.

    Parameters
    ----------
    evidence : mapping of str to (K,) array_like
        Of `measure_order`.
    confidence : float
        The model's; NaN if unknown.
    """
    evidence = add_confidence(evidence, confidence)
    return np.asarray(load_posterior("crossings").compute(evidence, bound_order(evidence))[0])


def bound_order(evidence: Mapping[str, ArrayLike]) -> Array:
    """Return b (K,): where height alone makes an order right by p, its probability is at most p = exp(-b)."""
    return np.asarray(np.logaddexp(0.0, -np.asarray(evidence["height"])))


def add_confidence(evidence: Mapping[str, ArrayLike], confidence: float) -> dict[str, ArrayLike]:
    """Return evidence about crossings with the confidence of their model, as log odds."""
    share = min(max(confidence, _MIN_SHARE), 1.0 - _MIN_SHARE)
    odds = _USUAL_ODDS if math.isnan(confidence) else math.log(share / (1.0 - share))
    return {**evidence, "confidence": odds}


def measure_order(
    height: Array,
    sd: Array,
    radii: Array,
    angle: Array,
    place: Array,
    doubts: Sequence[Doubt],
) -> dict[str, Array]:
    """Return the evidence (K,) about crossings by name.

    Parameters
    ----------
    height, sd : (K,) ndarray
        Height of the upper axis above the lower one, 0 or above, and its standard deviation, metres. NaN
        counts as half of both radii.
    radii : (K,) ndarray
        Sums of both ropes' radii, metres.
    angle : (K,) ndarray
        Angles between the strands, radians.
    place : (K, 3) ndarray
        Places of the crossings, metres.
    doubts : sequence of Doubt
        Those without a place count nowhere.

    Notes
    -----
    Ropes do not pass through each other: a true height is at least both radii r, or at most -r. Normal errors
    of width s weigh how well the measured height h agrees with either:

        log odds = ((h + r)^2 - min(h - r, 0)^2) / (2 s^2)

    Here s is three times the standard deviation, and at least r - h.
    """
    rise = height / radii
    with np.errstate(over="ignore", divide="ignore"):
        noise = np.hypot(_SD_FACTOR * np.where(np.isnan(sd), 0.5 * radii, sd) / radii, _MIN_SD)
        width = np.maximum(noise, 1.0 - rise)
        odds = ((rise + 1.0) ** 2 - np.minimum(rise - 1.0, 0.0) ** 2) / (2.0 * width**2)
    near = {"order": np.zeros(len(rise)), "rival": np.zeros(len(rise)), "other": np.zeros(len(rise))}
    for doubt in doubts:
        if doubt.place is not None:
            here = np.linalg.norm(place - doubt.place, axis=1) < 0.5 * _REACH * radii
            near[doubt.kind if doubt.kind in near else "other"] += here * doubt.amount
    with np.errstate(under="ignore"):
        return {
            "height": np.minimum(odds, _MAX_LOG_ODDS),
            "cut": np.minimum(np.maximum(1.0 - rise, 0.0), _MAX_CUT),
            "flat angle": np.maximum(_FLAT_ANGLE - angle, 0.0) / _FLAT_ANGLE,
            **{f"{kind} doubt": 1.0 - np.exp(-_STEEPNESS * amount) for kind, amount in near.items()},
        }
