"""Gaps through which cameras saw the background are doubted; gaps that a thing hides are not."""

from __future__ import annotations

import numpy as np

import strand
from strand.synthetic import Layout, Noise, scene

R = 4e-3


def lay_line(start, stop):
    x = np.arange(start, stop, 1e-3)
    return np.column_stack([x, np.zeros_like(x), np.full_like(x, R)])


def reconstruct(chains, views=1, ropes=None, **given):
    made = scene(chains=chains, radius=R, seed=3, noise=Noise(depth=0.1 * R), views=views, **given)
    return strand.reconstruct(made.views, R, made.bounds, ropes)


def test_a_pen_in_line_with_the_rope_is_no_sure_part_of_it():
    turn = strand.pose_from_angles(0.0, 0.0, 0.8, [0.0, 0.0, 0.0])[:3, :3]
    model = reconstruct([lay_line(-0.12, 0.0) @ turn.T, lay_line(1.5 * R, 0.12) @ turn.T], ropes=1)
    assert model.chains[0].length > 0.2
    assert any("cameras saw through" in doubt.reason for doubt in model.doubts)
    assert model.confidence < 0.8


def test_a_whole_rope_and_a_hidden_stretch_raise_no_doubt():
    assert reconstruct([lay_line(-0.12, 0.12)], ropes=1).confidence > 0.95
    bar = (np.array([[0.0, -0.1, 0.04], [0.0, 0.1, 0.04]]), 3.0 * R)
    hidden = reconstruct([lay_line(-0.12, 0.12)], ropes=1, layout=Layout(bars=(bar,)))
    assert not any("saw through" in doubt.reason for doubt in hidden.doubts)


def test_two_ropes_in_line_may_be_one_if_one_view_shows_the_gap():
    ropes = [lay_line(-0.12, 0.0), lay_line(7.0 * R, 0.15)]
    alone = reconstruct(ropes)
    assert len(alone.chains) == 2
    assert any("in line with it" in doubt.reason for doubt in alone.doubts)
    assert alone.confidence < 0.8
    # several views do not have the same wrong depth
    assert reconstruct(ropes, views=3).confidence > 0.9
    # a known number of ropes confirms the ends
    known = reconstruct(ropes, ropes=2)
    assert not any("in line with it" in doubt.reason for doubt in known.doubts)
    beside = [lay_line(-0.12, 0.0), lay_line(-0.1, 0.02) + np.array([0.0, 8.0 * R, 0.0])]
    assert not any("in line with it" in doubt.reason for doubt in reconstruct(beside).doubts)
