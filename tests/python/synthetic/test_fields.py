"""Smooth random images, and dilated masks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from strand.synthetic.fields import dilate, draw_field


@pytest.mark.parametrize("smoothness", [0.0, 0.8, 2.0, 4.0])
def test_fields_are_normal_and_have_the_given_smoothness(smoothness):
    made = draw_field((400, 500), smoothness, np.random.default_rng(1))
    assert made.shape == (400, 500)
    assert made.mean() == pytest.approx(0.0, abs=0.05)
    assert made.std() == pytest.approx(1.0, abs=0.05)
    for lag in (1, 3, 6):
        expected = math.exp(-0.25 * (lag / smoothness) ** 2) if smoothness else 0.0
        for a, b in ((made[lag:], made[:-lag]), (made[:, lag:], made[:, :-lag])):
            assert (a * b).mean() == pytest.approx(expected, abs=0.06)


def test_masks_dilate_equally_in_rows_and_columns():
    chosen = np.random.default_rng(2).random((40, 50)) < 0.01
    assert chosen.any()
    for reach in (0, 1, 3):
        square = np.ones((2 * reach + 1,) * 2, dtype=bool)
        assert np.array_equal(dilate(chosen, reach), binary_dilation(chosen, square))
