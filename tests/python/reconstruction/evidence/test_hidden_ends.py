"""Ends in a gripper are named as hidden, and ropes go on beneath a hand."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.occluded import GRIPPER, HAND, ROPE, R, make_view
from strand.reconstruction.evidence.hidden_ends import find_hidden_ends

LENGTH = float(np.linalg.norm(np.diff(ROPE, axis=0), axis=1).sum())
LOW = (np.array([-0.3, -0.3, 0.0025]), np.array([0.3, 0.3, 0.03]))
INPUTS = {
    "mask": ({"masked": True}, {"radius": R}),
    "table": ({}, {"radius": R}),
    "bounds": ({}, {"radius": R, "bounds": LOW}),
    "color": ({"colored": True, "noise": 0.004}, {}),
}


@pytest.mark.parametrize("kind", INPUTS)
def test_an_end_in_a_gripper_is_hidden_and_the_other_end_is_not(kind):
    drawn, given = INPUTS[kind]
    model = strand.reconstruct([make_view(GRIPPER, **drawn)], **given)
    (chain,) = model.chains
    assert chain.hidden_ends == (False, True)
    assert LENGTH - 0.12 < chain.length < LENGTH - 0.06
    (doubt,) = [doubt for doubt in chain.doubts if doubt.kind == "hidden end"]
    np.testing.assert_array_equal(doubt.place, chain.points[-1])
    assert "occluder" in doubt.reason
    assert any(warning.kind == "hidden end" and warning.chains == (0,) for warning in model.warnings)


@pytest.mark.parametrize("kind", INPUTS)
def test_a_rope_goes_on_beneath_a_hand(kind):
    drawn, given = INPUTS[kind]
    view = make_view(HAND, **drawn)
    (chain,) = strand.reconstruct([view], **given).chains
    assert chain.hidden_ends == (False, False)
    assert chain.length == pytest.approx(LENGTH, rel=0.02)
    columns, rows = np.rint(view.image.project(chain.points)).astype(int).T
    hidden = view.image.occluders[rows, columns]
    assert np.count_nonzero(hidden) > 40
    assert chain.bridged[hidden].mean() > 0.9
    assert not chain.bridged[np.abs(chain.points[:, 0]) > 0.08].any()


def test_an_unknown_gripper_hides_no_end():
    (chain,) = strand.reconstruct([make_view(GRIPPER, known=False, masked=True)], radius=R).chains
    assert chain.hidden_ends == (False, False)


def test_an_end_that_another_view_sees_is_not_hidden():
    short = ROPE[ROPE[:, 0] < 0.0]
    view = make_view(HAND, 0.3)
    chain = strand.Chain(ROPE[ROPE[:, 0] < -0.03], R)
    poses = [view.pose]
    assert find_hidden_ends([chain], [view], poses) == [(False, True)]
    assert find_hidden_ends([chain.reversed()], [view], poses) == [(True, False)]
    # an end in the open, several radii before the hand
    assert find_hidden_ends([strand.Chain(short[:100], R)], [view], poses) == [(False, False)]


def test_a_reversed_chain_has_its_hidden_ends_reversed():
    chain = strand.Chain(ROPE, R, hidden_ends=(True, False))
    assert chain.reversed().hidden_ends == (False, True)
    with pytest.raises(ValueError, match="hidden_ends: expected two bools, got 1"):
        strand.Chain(ROPE, R, hidden_ends=(True,))
    with pytest.raises(TypeError, match="hidden_ends"):
        strand.Chain(ROPE, R, hidden_ends=(1, 0))
