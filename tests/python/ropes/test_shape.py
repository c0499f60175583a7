"""Ropes compared with target shapes."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import R, draw_circle
from strand import Chain

S = np.linspace(0.0, 0.2, 101)
LINE = np.stack([S, 0 * S, 0 * S], axis=1)
ASIDE = np.array([0, 0.01, 0])


def test_a_rope_beside_its_target_is_as_far_off_as_it_is():
    error = Chain(LINE + ASIDE, R).shape_error([[0, 0, 0], [0.2, 0, 0]])
    assert (error.rms, error.worst) == pytest.approx((0.01, 0.01))
    assert (error.longer, error.reversed) == (pytest.approx(0.0), False)
    np.testing.assert_allclose(error.offsets, np.tile(-ASIDE, (200, 1)), atol=1e-12)


def test_a_rope_may_run_the_other_way():
    error = Chain(LINE[::-1], R).shape_error(Chain(LINE, R))
    assert error.reversed
    assert error.worst < 1e-12


def test_the_worst_place_is_said():
    bump = 0.02 * np.exp(-(((S - 0.05) / 0.01) ** 2))
    error = Chain(LINE + np.stack([0 * S, bump, 0 * S], axis=1), R).shape_error(LINE)
    assert error.longer > 0.01
    chain = Chain(LINE + np.stack([0 * S, bump, 0 * S], axis=1), R)
    assert chain.at(error.s)[0] == pytest.approx(0.05, abs=0.01)
    k = np.linalg.norm(error.offsets, axis=1).argmax()
    assert error.s == error.arc_lengths[k]
    assert error.worst == pytest.approx(np.linalg.norm(error.offsets[k]))


def test_rings_may_start_anywhere_and_run_either_way():
    ring = draw_circle(0.05, 200, True)
    turned = Chain(np.roll(ring.points, 71, axis=0)[::-1], R, closed=True)
    assert ring.shape_error(turned).worst < 0.002
    assert ring.shape_error(0.9 * ring.points).rms == pytest.approx(0.005, rel=1e-3)


def test_targets_that_make_no_sense_are_refused():
    chain = Chain(LINE, R)
    for target, message in (
        ([[0.0, 0, 0]], "at least two"),
        ([[0.0, 0, 0], [0.0, 0, 0]], "at least two"),
        ([[0.0, 0], [1.0, 0]], "shape"),
        ([[0.0, 0, np.nan], [1.0, 0, 0]], "finite"),
        (draw_circle(0.05, 100, True), "open"),
    ):
        with pytest.raises(ValueError, match=f"target: .*{message}"):
            chain.shape_error(target)
