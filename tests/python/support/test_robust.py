"""Tests of the robust standard deviation."""

from __future__ import annotations

import numpy as np
import pytest

from strand.support.robust import estimate_deviation


def test_it_is_the_standard_deviation_of_normal_errors_whatever_outliers_there_are():
    rng = np.random.default_rng(0)
    errors = rng.normal(0.0, 3.0, 20_000)
    assert estimate_deviation(errors) == pytest.approx(3.0, rel=0.02)
    errors[:100] = 1e9
    assert estimate_deviation(errors) == pytest.approx(3.0, rel=0.03)


def test_no_errors_have_no_deviation():
    assert estimate_deviation(np.empty(0)) == 0.0
