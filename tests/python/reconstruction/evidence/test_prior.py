"""What is known of the ropes beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import R
from strand.reconstruction.evidence.prior import Prior


def test_lengths_are_those_of_the_ropes_that_they_fit_best():
    known = Prior.from_caller(None, [0.3, 0.5, 0.4])
    assert known.ropes == 3
    assert known.match_lengths([0.31, 0.42, 0.49]) == [0.3, 0.4, 0.5]
    assert known.match_lengths([0.41]) == [0.4]
    assert known.match_lengths([0.1, 0.5, 0.4, 0.3]) == [None, 0.5, 0.4, 0.3]
    every = Prior.from_caller(2, np.float64(0.3))
    assert (every.ropes, every.match_lengths([0.2, 0.1, 0.3])) == (2, [0.3, 0.3, 0.3])
    assert every.select_common().match_lengths([0.2]) == [0.3]
    assert known.select_common().lengths == ()
    assert known.measure_excess(0.305, 0.3, R) == 0.0
    assert known.measure_excess(0.4, 0.3, 0.005) == pytest.approx(20.0 - 1.2 - 1.0)
    assert known.measure_excess(0.4, None, R) == 0.0
