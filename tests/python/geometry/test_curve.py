"""Splines asked by arc length."""

from __future__ import annotations

import numpy as np
import pytest

from strand.geometry.curve import Curve


def test_a_curve_knows_its_arc_length_and_curvature():
    angle = np.linspace(0, 2 * np.pi, 41)
    control = 0.05 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    curve = Curve.whole(control).trimmed(0.02, 0.12)
    assert curve.length == pytest.approx(0.1, rel=1e-6)
    position, tangent, bend = curve.at(curve.spaced(0.005))
    np.testing.assert_array_equal(curve.place_at(curve.spaced(0.005)), position)
    radius = np.linalg.norm(position, axis=1)
    np.testing.assert_allclose(np.linalg.norm(bend, axis=1), 1 / radius, rtol=3e-3)
    np.testing.assert_allclose((tangent * bend).sum(axis=1), 0.0, atol=1e-9)
    np.testing.assert_allclose(
        curve.arc_length_at(curve.parameter_at([0.0, 0.05, 0.1])), [0.0, 0.05, 0.1], atol=1e-9
    )
    with pytest.raises(ValueError, match="start, stop"):
        Curve(control, 3.0, 2.0)
    with pytest.raises(ValueError, match="control: expected at least four"):
        Curve(control[:3], 0.0, 0.5)
