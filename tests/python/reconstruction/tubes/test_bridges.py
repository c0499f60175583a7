"""Curves over gaps."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import R, measure_length
from strand.config import Linking
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.tubes.bridges import make_bridge
from strand.views.box import Box


def test_a_bridge_has_the_given_length():
    before = np.linspace([-0.05, 0.0, 0.0], [0.0, 0.0, 0.0], 21)
    after = np.linspace([0.08, 0.01, 0.0], [0.13, 0.01, 0.0], 21)
    evidence = JoinEvidence(R, Linking())
    for length in (0.085, 0.095):
        nodes = make_bridge(before, after, evidence, length)
        way = np.vstack([before[-1:], nodes, after[:1]])
        assert measure_length(way) == pytest.approx(length, rel=1e-6)
    box = Box([-1.0, -1.0, -0.002], [1.0, 0.014, 1.0])
    nodes = make_bridge(before, after, JoinEvidence(R, Linking(), prior=Prior(bounds=box)), 0.095)
    assert ((nodes > box.low) & (nodes < box.high)).all()
    plain = make_bridge(before, after, evidence)
    for length in (0.01, 0.15, 0.5):
        nodes = make_bridge(before, after, evidence, length)
        np.testing.assert_array_equal(nodes, plain)
