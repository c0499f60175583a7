"""Splines asked by arc length."""

from __future__ import annotations

import numpy as np
import pytest

import strand._core as _core
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


def test_places_of_a_spline_have_the_tangents_and_curvatures_of_the_formula():
    rng = np.random.default_rng(3)
    control, u = rng.normal(size=(9, 3)), np.append(rng.uniform(0.0, 6.0, 40), [0.0, 3.0, 6.0])
    first = np.minimum(u.astype(np.int64), 5)
    t = u - first
    s = 1.0 - t
    near = control[first[:, None] + np.arange(4)]
    weights = np.stack([s**3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1) / 6
    slopes = np.stack([-(s**2), 3 * t**2 - 4 * t, -3 * t**2 + 2 * t + 1, t**2], axis=1) / 2
    bends = np.stack([s, 3 * t - 2, 1 - 3 * t, t], axis=1)
    position, slope, bend = (np.einsum("ij,ijk->ik", of, near) for of in (weights, slopes, bends))
    square, along = ((slope * other).sum(axis=1, keepdims=True) for other in (slope, bend))
    expected = position, slope / np.sqrt(square), (bend - slope * along / square) / square
    for found, wanted in zip(_core.evaluate_spline(control, u), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-12)
