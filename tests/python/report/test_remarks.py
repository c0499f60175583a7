"""Tests of the list of doubts and warnings."""

from __future__ import annotations

import numpy as np

import strand
from strand.report.remarks import Remark, list_remarks
from strand.ropes.doubt import Doubt, ModelWarning


def make_model(doubts, warnings):
    return strand.Model((), np.eye(4)[None], doubts=doubts, warnings=warnings)


def test_remarks_are_sorted_by_weight():
    doubts = [Doubt("join", 0.2, "how", "a"), Doubt("end", 0.7, "where", "b")]
    warned = ModelWarning("thing", "c")
    assert list_remarks(make_model(doubts, [warned])) == (
        Remark("unsure where: b", 0.7, False),
        Remark("unsure how: a", 0.2, False),
        Remark("c", 0.0, True),
    )
    assert list_remarks(make_model([], [])) == ()


def test_a_doubt_and_its_warning_are_one_remark():
    doubt = Doubt("count", 0.4, "that", "few")
    own = ModelWarning("count", "few ropes", amount=0.4)
    other = ModelWarning("count", "few views", amount=0.3)
    assert list_remarks(make_model([doubt, doubt], [other, own])) == (
        Remark("few ropes", 0.4, True),
        Remark("unsure that: few", 0.4, False),
        Remark("few views", 0.0, True),
    )


def test_repeated_texts_are_listed_once_with_the_greater_weight():
    doubts = [Doubt("end", weight, "it", "why") for weight in (0.1, 0.3, 0.2)]
    assert list_remarks(make_model(doubts, [])) == (Remark("unsure it: why", 0.3, False),)
