"""Preparing arcs for joining."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from shared.ropes import R, draw_line
from strand.config import Linking
from strand.reconstruction.tubes.arc_repair import cut_at_contacts, turn_stubs


def test_a_stub_beyond_a_crossing_is_turned_to_the_arc_that_points_at_it():
    arc = draw_line([-0.05, 0.0, 0.0], [0.0, 0.0, 0.0])
    across = draw_line([4 * R, -0.8 * R, 0.0], [4 * R, 0.8 * R, 0.0])
    _, stub = turn_stubs([arc, across], R)
    step = stub[-1] - stub[0]
    assert abs(step[0]) == pytest.approx(np.linalg.norm(step), rel=0.02)
    np.testing.assert_allclose(stub.mean(axis=0), [4 * R, 0, 0], atol=0.3 * R)
    long = draw_line([4 * R, -3 * R, 0.0], [4 * R, 3 * R, 0.0])
    np.testing.assert_array_equal(turn_stubs([arc, long], R)[1], long)


def test_an_arc_is_cut_where_another_runs_into_it():
    line = np.linspace(-0.05, 0.05, 60)
    through = np.stack([line, 0 * line, 0 * line], axis=1)
    into = np.stack([0 * line, np.linspace(0.5 * R, 0.08, 60), 0 * line], axis=1)
    assert [len(part) > 3 for part in cut_at_contacts([through, into], R, Linking())] == [True] * 3
    clear = into + np.array([0.0, 2 * R, 0.0])
    assert len(cut_at_contacts([through, clear], R, Linking())) == 2


def test_cutting_long_arcs_takes_memory_in_proportion_to_their_nodes():
    s = np.arange(0.0, 10.0, 0.5 * R)
    through = np.stack([s - 5.0, 0 * s, 0 * s], axis=1)
    into = np.stack([0 * s, 0.5 * R + s, 0 * s], axis=1)
    tracemalloc.start()
    parts = cut_at_contacts([through, into], R, Linking(), back=6.0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(parts) == 3
    assert peak < 2000 * len(s)
