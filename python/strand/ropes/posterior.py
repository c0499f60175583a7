"""The probability that an answer is right, from weights of evidence that a bench learned.

The answer, its alternatives and "none of these" exclude each other. With the evidence x, weights w, and b of
the gravest doubt,

    P(one of them) = exp(-b) / (1 + exp(-(w0 + w.x)))

and they share this probability as 1 : c exp(-d1 / T) : c exp(-d2 / T) ..., where d is how much more an
alternative costs than the answer. `benches/confidence.py` fits w, c and T to answers beside the truth.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from strand.support.checks import Array

PATH = Path(__file__).with_name("posterior.json")
"""The weights that `benches/confidence.py` writes."""


@dataclass(frozen=True)
class Posterior:
    """Weights of evidence.

    Attributes
    ----------
    intercept : float
    weights : mapping of str to float
        By the evidence's name. Evidence without a weight does not count.
    scale : float
        T: how much more an alternative costs that is less likely by a factor of e.
    share : float
        c: the odds of an alternative that costs no more, against the answer.
    """

    intercept: float
    weights: Mapping[str, float]
    scale: float = 1.0
    share: float = 1.0

    def compute(
        self, evidence: Mapping[str, ArrayLike], bound: ArrayLike = 0.0, costs: Sequence[float] = ()
    ) -> Array:
        """Return the probabilities of the answer, and of each alternative that costs so much more.

        Evidence and b may be numbers or (K,) arrays, for K answers. The result has a first axis of answers
        and alternatives.
        """
        odds = self.intercept + sum(
            self.weights.get(name, 0.0) * (value if isinstance(value, float) else np.asarray(value))
            for name, value in evidence.items()
        )
        with np.errstate(under="ignore", over="ignore"):
            fitted = np.exp(-np.asarray(bound)) / (1.0 + np.exp(-odds))
            shares = np.array([1.0, *(self.share * np.exp(-max(cost, 0.0) / self.scale) for cost in costs)])
            return np.asarray(np.multiply.outer(shares / shares.sum(), fitted))


@cache
def load_posterior(name: str) -> Posterior:
    """Load the weights of "answers", of single "chains", or of "crossings"."""
    return Posterior(**json.loads(PATH.read_text(encoding="utf-8"))[name])
