"""An answer in words."""

from __future__ import annotations

import numpy as np
import pytest

from strand import Chain, Model
from strand.ropes.doubt import Doubt

R = 0.004
LINE = np.linspace([-0.1, 0.0, R], [0.1, 0.0, R], 41)
ACROSS = np.linspace([0.0, -0.1, 3 * R], [0.0, 0.1, 3 * R], 41)


@pytest.mark.parametrize(
    ("confidence", "words"),
    [
        (0.97, "Act on it: the ropes run as the chains say with probability 0.97."),
        (0.9, "Act on it: the ropes run as the chains say with probability 0.90."),
        (0.8999, "Look again before acting: the ropes run as the chains say with probability 0.89."),
        (0.29, "Do not act on it: the ropes run as the chains say with probability 0.29."),
        (0.49, "Do not act on it: "),
        (np.nan, "Check it: the method does not say how sure the answer is."),
    ],
)
def test_the_first_line_says_whether_to_act(confidence, words):
    model = Model((Chain(LINE, R),), np.eye(4)[None], confidence=confidence)
    assert model.summary().splitlines()[0].startswith(words)


def test_a_summary_lists_chains_crossings_and_the_greatest_doubts():
    doubts = tuple(
        Doubt("end", amount, "where it ends", f"reason {amount}") for amount in (0.4, 0.3, 0.2, 0.1)
    )
    model = Model((Chain(LINE, R), Chain(ACROSS, R)), np.eye(4)[None], confidence=0.6, doubts=doubts)
    lines = model.summary().splitlines()
    assert [line.split(":")[0] for line in lines[1:3]] == ["chain 0", "chain 1"]
    assert lines[3] == str(model.crossings()[0])
    assert lines[4:7] == [str(doubt) for doubt in doubts[:3]]
    assert lines[7:] == ["further doubts: 1"]
