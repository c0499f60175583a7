"""Probabilities of answers from weights of evidence."""

from __future__ import annotations

import numpy as np
import pytest

from strand.ropes.doubt import DOUBTS
from strand.ropes.posterior import Posterior, load_posterior

NAMES = ("answers", "chains", "crossings")


def test_evidence_adds_to_the_log_odds():
    posterior = Posterior(1.0, {"end": -2.0, "seen": 0.5})
    (said,) = posterior.compute({"end": 0.75, "seen": 1.0, "unknown": 9.0})
    assert said == pytest.approx(0.5)
    (said,) = posterior.compute({"end": 0.0})
    assert said == pytest.approx(1.0 / (1.0 + np.exp(-1.0)))


def test_an_answer_and_its_alternatives_exclude_each_other():
    posterior = Posterior(2.0, {}, scale=2.0, share=0.5)
    said = posterior.compute({}, 0.0, [0.0, 4.0])
    assert said.sum() == pytest.approx(1.0 / (1.0 + np.exp(-2.0)))
    assert said / said[0] == pytest.approx([1.0, 0.5, 0.5 * np.exp(-2.0)])
    # an alternative that costs less than the answer counts as one that costs as much
    assert posterior.compute({}, 0.0, [-3.0, 4.0]) == pytest.approx(said)


def test_the_gravest_doubt_bounds_the_probability():
    posterior = Posterior(9.0, {})
    assert posterior.compute({}, 0.7)[0] == pytest.approx(np.exp(-0.7), rel=1e-3)


def test_several_answers_at_once():
    posterior = Posterior(1.0, {"end": -2.0})
    said = posterior.compute({"end": np.array([0.0, 0.5, 1.0])})
    assert said.shape == (1, 3)
    for amount, one in zip([0.0, 0.5, 1.0], said[0], strict=True):
        assert one == posterior.compute({"end": amount})[0]


@pytest.mark.parametrize("name", NAMES)
def test_no_doubt_makes_an_answer_surer(name):
    posterior = load_posterior(name)
    assert posterior.scale > 0.0 < posterior.share
    for kind in DOUBTS:
        assert posterior.weights.get(kind, 0.0) <= 0.0, kind
