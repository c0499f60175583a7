"""Errors of depth images."""

from __future__ import annotations

import numpy as np
import pytest

from strand.reconstruction.evidence.depth_errors import find_depth_step


def test_steps_of_depths_are_seen_where_there_are_some():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.3, 0.5, 3000)
    assert find_depth_step(np.rint(depth / 1e-3) * 1e-3) == pytest.approx(1e-3)
    assert find_depth_step(depth) == 0.0
