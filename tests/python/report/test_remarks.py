"""What is to be said against an answer."""

from __future__ import annotations

import numpy as np

import strand
from strand.report.remarks import Remark, list_remarks
from strand.ropes.doubt import Doubt, ModelWarning


def model_of(doubts, warnings):
    return strand.Model((), np.eye(4)[None], doubts=doubts, warnings=warnings)


def test_the_heaviest_is_first_and_what_has_no_weight_last():
    doubts = [Doubt("join", 0.2, "how", "a"), Doubt("end", 0.7, "where", "b")]
    warned = ModelWarning("thing", "c")
    assert list_remarks(model_of(doubts, [warned])) == (
        Remark("unsure where: b", 0.7, False),
        Remark("unsure how: a", 0.2, False),
        Remark("c", 0.0, True),
    )
    assert list_remarks(model_of([], [])) == ()


def test_a_warning_about_a_doubt_is_one_with_it():
    doubt = Doubt("count", 0.4, "that", "few")
    own = ModelWarning("count", "few ropes", amount=0.4)
    other = ModelWarning("count", "few views", amount=0.3)
    assert list_remarks(model_of([doubt, doubt], [other, own])) == (
        Remark("few ropes", 0.4, True),
        Remark("unsure that: few", 0.4, False),
        Remark("few views", 0.0, True),
    )


def test_the_same_words_are_said_once_with_the_greater_weight():
    doubts = [Doubt("end", weight, "it", "why") for weight in (0.1, 0.3, 0.2)]
    assert list_remarks(model_of(doubts, [])) == (Remark("unsure it: why", 0.3, False),)
