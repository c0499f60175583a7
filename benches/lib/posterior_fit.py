"""Fit the weights of evidence to answers beside the truth, see `strand.ropes.posterior`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from strand.reconstruction.evidence.measured import COURSE_DOUBTS
from strand.ropes.posterior import Posterior

Array = NDArray[np.float64]

DOUBT_WEIGHT = -0.5  # of a doubt before any answer is seen
AGAINST = {
    *COURSE_DOUBTS,
    "order",
    "doubts",
    "root of doubts",
    "short chains",
    "unseen share",
    "unseen stretch",
} | {
    "ends at strands",
    "bend",
    "deviation",
    "cut",
    "flat angle",
    *(f"{kind} doubt" for kind in ("order", "rival", "other")),
}
"""Evidence against an answer: its weight is at most 0."""
START = 2.0  # intercept, first guess
STRENGTH = 2.0  # answers' worth: per squared weight of evidence that varies by 1
LEAST_STRENGTH = 1.0  # the same of evidence that never varies
LEAST_BOUND = 1e-6  # keeps logarithms finite
DIGITS = 3  # of weights in the table


@dataclass(frozen=True)
class Example:
    """An answer beside the truth.

    Attributes
    ----------
    evidence : mapping of str to float
    costs : sequence of float
        Of the alternatives, above the answer's.
    right : int or None
        0 if the answer is right, k if the k-th alternative is; None if none is.
    bound : float
        b of its gravest doubt: the probability is at most exp(-b).
    """

    evidence: Mapping[str, float]
    costs: Sequence[float]
    right: int | None
    bound: float = 0.0


def fit_posterior(examples: Sequence[Example]) -> Posterior:
    """Fit weights by the greatest likelihood, drawn towards what is expected of each."""
    known = COURSE_DOUBTS if any(set(COURSE_DOUBTS) & example.evidence.keys() for example in examples) else ()
    names = sorted({*known, *(name for example in examples for name in example.evidence)})
    x = np.array([[example.evidence.get(name, 0.0) for name in names] for example in examples])
    usual = np.array([DOUBT_WEIGHT if name in COURSE_DOUBTS else 0.0 for name in names])
    costs = np.full((len(examples), max(len(example.costs) for example in examples)), np.inf)
    for row, example in enumerate(examples):
        costs[row, : len(example.costs)] = np.maximum(example.costs, 0.0)
    outcome = np.array([-1 if example.right is None else example.right for example in examples])
    bound = np.exp([-max(example.bound, LEAST_BOUND) for example in examples])
    strength = LEAST_STRENGTH + STRENGTH * x.var(axis=0)
    fitted, rows = outcome >= 0, np.arange(len(x))
    chosen = np.maximum(outcome, 0)
    none = np.zeros((len(x), 1))
    finite = np.where(np.isfinite(costs), costs, 0.0)

    def compute_loss(w: Array) -> tuple[float, Array]:
        weights, (scale, share) = w[1:-2], np.exp(w[-2:])
        odds = w[0] + x @ weights
        shares = np.concatenate([none + 1.0, share * np.exp(-costs / scale)], axis=1)
        shares /= shares.sum(axis=1, keepdims=True)
        sure = 1.0 / (1.0 + np.exp(-odds))
        missed = 1.0 - bound * sure
        loss = float(np.where(fitted, np.logaddexp(0.0, -odds), -np.log(missed)).sum())
        loss -= float(np.log(shares[rows, chosen][fitted] + np.finfo(float).tiny).sum())
        away = weights - usual
        loss += 0.5 * float(strength @ away**2 + w[-2:] @ w[-2:])
        slope = np.where(fitted, sure - 1.0, bound * sure * (1.0 - sure) / missed)
        # shares are a softmax of log c - cost / T: slopes by log T and log c
        by_scale = np.concatenate([none, finite / scale], axis=1)
        by_share = np.concatenate([none, np.ones_like(costs)], axis=1)
        last = [((shares * by).sum(axis=1) - by[rows, chosen])[fitted].sum() for by in (by_scale, by_share)]
        return loss, np.concatenate([[slope.sum()], x.T @ slope + strength * away, last + w[-2:]])

    highest = [None, *(0.0 if name in AGAINST else None for name in names), None, None]
    start = np.concatenate([[START], usual, [1.0, 0.0]])
    w = minimize(
        compute_loss,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=[(None, high) for high in highest],
        options={"maxiter": 2000},
    ).x
    rounded = [round(float(value), DIGITS) for value in (w[0], *w[1:-2], *np.exp(w[-2:]))]
    weights = {name: value for name, value in zip(names, rounded[1:-2], strict=True) if value}
    return Posterior(rounded[0], weights, *rounded[-2:])
