"""Ends of ropes that are moved."""

from __future__ import annotations

import numpy as np
import pytest

from strand.geometry.polyline import path_length
from strand.reconstruction.images.image_ends import _change_end

RADIUS = 0.004


def test_ends_are_cut_and_extended_along_the_table():
    table = np.array([0.0, 0.0, 1.0]), 0.0
    x = np.linspace(0.0, 40.0, 81)
    rising = RADIUS * np.stack([x, 0.0 * x, 1.0 + 0.2 * np.maximum(x - 35.0, 0.0)], axis=1)
    cut = _change_end(rising, 3.0 * RADIUS, 0.0, 0.0, table, RADIUS)
    assert path_length(rising)[-1] - path_length(cut)[-1] == pytest.approx(3.0 * RADIUS)
    assert np.array_equal(_change_end(rising, 0.0, 0.0, 0.0, table, RADIUS), rising)
    level = _change_end(rising, 0.0, 3.0 * RADIUS, 0.0, table, RADIUS)
    assert level[-1, 2] == pytest.approx(rising[-1, 2])
    assert level[-1, 0] - rising[-1, 0] == pytest.approx(3.0 * RADIUS, rel=0.05)
    falling = _change_end(rising, 0.0, 6.0 * RADIUS, 0.4, table, RADIUS)
    assert falling[-1, 2] == pytest.approx(RADIUS)
    assert falling[:, 2].min() >= RADIUS - 1e-12
    # a rope is not cut before its middle
    short = _change_end(rising[:5], 3.0 * RADIUS, 0.0, 0.0, table, RADIUS)
    assert path_length(short)[-1] == pytest.approx(0.5 * path_length(rising[:5])[-1])
    upright = RADIUS * np.stack([0.0 * x, 0.0 * x, 1.0 + x], axis=1)
    assert np.array_equal(_change_end(upright, 0.0, 3.0 * RADIUS, 0.0, table, RADIUS), upright)
