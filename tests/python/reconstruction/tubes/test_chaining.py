"""Chains made of arcs and joins."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import R, draw_line, measure_length
from strand.config import Linking
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.tubes.chaining import chain_arcs, chain_arcs_to_length


def test_arcs_in_any_direction_become_one_chain():
    left, right = draw_line([-0.06, 0, 0], [-0.01, 0, 0]), draw_line([0.01, 0, 0], [0.06, 0, 0])
    for arcs, join in (([left, right], (1, 2)), ([left[::-1], right], (0, 2)), ([left, right[::-1]], (1, 3))):
        ((nodes, closed),) = chain_arcs(arcs, [join], JoinEvidence(R, Linking()))
        assert not closed
        assert measure_length(nodes) == pytest.approx(0.12, rel=1e-6)
        assert (np.diff(nodes[:, 0]) > 0).all() or (np.diff(nodes[:, 0]) < 0).all()
        assert np.linalg.norm(np.diff(nodes, axis=0), axis=1).max() < 0.6 * R
    assert len(chain_arcs([left, right], [], JoinEvidence(R, Linking()))) == 2


def test_an_arc_whose_ends_are_joined_becomes_a_ring():
    angle = np.linspace(0.1, 2.0 * np.pi - 0.1, 200)
    arc = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    ((nodes, closed),) = chain_arcs([arc], [(0, 1)], JoinEvidence(R, Linking()))
    assert closed
    np.testing.assert_array_equal(nodes[0], nodes[-1])
    assert measure_length(nodes) == pytest.approx(0.1 * np.pi, rel=1e-3)


def test_a_bow_makes_up_for_what_a_known_length_lacks():
    arcs = [draw_line([-0.15, 0, 0], [-0.04, 0, 0]), draw_line([0.04, 0, 0], [0.15, 0, 0])]
    for length in (0.305, 0.31):
        evidence = JoinEvidence(R, Linking(), prior=Prior.from_caller(1, length))
        ((nodes, _),) = chain_arcs_to_length(arcs, [(1, 2)], evidence)
        assert measure_length(nodes) == pytest.approx(length, rel=1e-4)
    # no arc is made shorter, and no bow bends more tightly than a rope can
    for length in (0.2, 0.33):
        evidence = JoinEvidence(R, Linking(), prior=Prior.from_caller(1, length))
        ((nodes, _),) = chain_arcs_to_length(arcs, [(1, 2)], evidence)
        assert measure_length(nodes) == pytest.approx(0.3, rel=1e-3)
