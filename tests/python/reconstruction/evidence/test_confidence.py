"""How sure an answer is."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.reconstruction.evidence.measured import (
    CONTRADICTIONS,
    Circumstances,
    describe_shapes,
    measure_bound,
    measure_evidence,
)
from strand.ropes.chain import Chain
from strand.ropes.doubt import DOUBTS, Doubt
from strand.ropes.posterior import load_posterior

R = 0.004
LINE = np.linspace([-0.1, 0.0, R], [0.1, 0.0, R], 201)
HOW = Circumstances(None, 3, True, False, False, False, False, False)


ROPE = Chain(LINE, R)


def say(doubts, chains=(ROPE,)):
    """Return the probability of chains with doubts."""
    evidence = measure_evidence(doubts, describe_shapes(chains), HOW)
    return load_posterior("answers").compute(evidence, measure_bound(doubts))[0]


def make_doubt(kind, amount):
    return Doubt(kind, amount, "it", "why")


def test_the_answer_and_its_alternatives_exclude_each_other(paper_model, tucked_under):
    scene = tucked_under
    for model in (paper_model, strand.reconstruct(scene.views, scene.radius, scene.bounds)):
        every = [model.confidence, *(other.probability for other in model.alternatives)]
        assert all(0.0 < said < 1.0 for said in every)
        assert sum(every) <= 1.0
        assert all(model.confidence <= chain.confidence + 0.1 for chain in model.chains)


def test_the_greatest_doubt_is_first(paper_model):
    amounts = [doubt.amount for doubt in paper_model.doubts]
    assert amounts == sorted(amounts, reverse=True)


@pytest.mark.parametrize("kind", DOUBTS)
def test_a_graver_doubt_makes_an_answer_no_surer(kind):
    said = [say([make_doubt(kind, amount)]) for amount in (0.0, 0.1, 0.3, 1.0, 3.0)]
    assert (np.diff(said) <= 0.0).all()
    assert said[-1] < 0.3 * said[0] or kind not in CONTRADICTIONS
    assert said[-1] < 0.75 or kind == "order"


def test_two_doubts_about_the_input_count_once():
    one = say([make_doubt("pose", 0.7)])
    assert say([make_doubt("pose", 0.7), make_doubt("depth", 0.7)]) == one
    assert one <= np.exp(-0.5 * 0.7)


def test_pieces_and_ends_at_strands_make_an_answer_less_sure():
    short = Chain(LINE[:60], R)
    beside = Chain(LINE + np.array([0.0, 2.2 * R, 0.0]), R)
    assert say([], (ROPE, short)) < say([])
    assert say([], (ROPE, beside)) < say([])


def test_evidence_of_a_bend_and_of_an_unseen_stretch():
    angle = np.linspace(0.0, np.pi, 50)
    turn = 2.0 * R * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    seen = np.ones(50, dtype=int)
    seen[10:30] = 0
    evidence = measure_evidence([], describe_shapes([Chain(turn, R, points_seen=seen)]), HOW)
    assert evidence["bend"] == pytest.approx(0.5, rel=0.05)
    length = 2.0 * np.pi / 50 * 20
    assert evidence["unseen stretch"] == pytest.approx(length / 15.0, rel=0.01)
    assert evidence["unseen share"] == pytest.approx(0.4)
