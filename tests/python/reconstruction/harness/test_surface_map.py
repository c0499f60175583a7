"""Maps of ropes as they are seen from one side."""

from __future__ import annotations

import numpy as np
import pytest

from strand.reconstruction.harness.surface_map import make_map

RADIUS = 0.005  # metres
UP = np.array([0.0, 0.0, 1.0])


def draw_tube(rng):
    """Return points on a tube along x that lies on a table at z = 0, metres."""
    x, angle = rng.uniform(-0.08, 0.08, 40_000), rng.uniform(0.0, 2.0 * np.pi, 40_000)
    return np.column_stack([x, RADIUS * np.cos(angle), RADIUS * (1.0 + np.sin(angle))])


@pytest.mark.parametrize("degrees", [0.0, 30.0, 55.0])
def test_a_tube_is_as_wide_and_its_ridge_as_high_as_seen(degrees):
    toward = np.array([0.0, np.sin(np.radians(degrees)), np.cos(np.radians(degrees))])
    points = draw_tube(np.random.default_rng(5))
    axis = np.array([0.0, 0.0, RADIUS])
    points = points[(points - axis) @ toward > 0.0]
    drawn = make_map([points], (axis + toward)[None], np.empty((0, 3)), UP, toward, (RADIUS, RADIUS), 0)
    along = np.column_stack([np.linspace(-0.05, 0.05, 21), np.zeros(21), np.full(21, RADIUS)])
    places, heights = drawn.flatten(along)
    np.testing.assert_allclose(drawn.lift(places, heights), along, atol=1e-12)
    np.testing.assert_allclose(heights, RADIUS, atol=1e-12)
    assert drawn.ridge == pytest.approx(np.cos(np.radians(degrees)))
    surface = drawn.sample_heights(places) - heights
    np.testing.assert_allclose(surface, drawn.ridge * RADIUS, atol=0.2 * RADIUS)
    np.testing.assert_allclose(drawn.sample_widths(places) * drawn.cell, RADIUS, atol=0.25 * RADIUS)
