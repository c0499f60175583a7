"""Tests of the plan of a figure."""

from __future__ import annotations

import numpy as np
import pytest

from strand.report.drawing import Plan


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_plan_is_seen_from_the_cameras(axis, side):
    viewpoints = np.full((2, 3), [[0.1], [-0.1]])
    viewpoints[:, axis] = side
    plan = Plan.from_viewpoints(viewpoints, np.zeros((1, 3)))
    right, up, towards = (plan.signs[k] * np.eye(3)[plan.axes[k]] for k in range(3))
    np.testing.assert_array_equal(towards, side * np.eye(3)[axis])
    np.testing.assert_array_equal(np.cross(right, up), towards)
