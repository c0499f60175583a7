"""Remarks about chains, which change without their nodes."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.ropes.chain import remarked


def test_remarks_change_and_nodes_stay():
    chain = strand.Chain(np.array([[0.0, 0, 0], [0.3, 0, 0], [0.3, 0.4, 0]]), 0.004, confidence=0.3)
    other = remarked(chain, confidence=0.9, hidden_ends=(True, False))
    assert (other.confidence, other.hidden_ends, other.length) == (0.9, (True, False), chain.length)
    assert (chain.confidence, chain.hidden_ends) == (0.3, (False, False))
    assert other.points is chain.points
    with pytest.raises(ValueError, match="confidence"):
        remarked(chain, confidence=1.5)
