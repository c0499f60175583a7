"""Crossings of chains in a plan."""

from __future__ import annotations

import numpy as np
import pytest

from strand import Chain
from strand.report.crossings import crossings, side_seen

UP = np.array([0.0, 0.0, 1.0])
S = np.linspace(-0.1, 0.1, 41)[:, None]


def straight(direction, height):
    return Chain(S * direction + [0.003, 0.001, height], 0.004)


@pytest.mark.parametrize(("towards", "over"), [(UP, 1), (-UP, 0)])
def test_who_is_over_whom_and_where(towards, over):
    low, high = straight([1, 0, 0], 0.0), straight([0.6, 0.8, 0], 0.01)
    (found,) = crossings([low, high], towards)
    assert (found.over[0], found.under[0]) == (over, 1 - over)
    np.testing.assert_allclose(found.place, [0.003, 0.001, 0.005], atol=1e-9)
    assert found.over[1] == pytest.approx(0.1)
    assert found.under[1] == pytest.approx(0.1)


def test_a_trefoil_crosses_itself_three_times():
    t = np.linspace(0, 2 * np.pi, 300, endpoint=False)
    x, y = np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t)
    knot = Chain(0.03 * np.stack([x, y, -np.sin(3 * t)], axis=1), 0.004, closed=True)
    found = crossings([knot], UP)
    assert len(found) == 3
    for crossing in found:
        assert knot.at(crossing.over[1])[2] > knot.at(crossing.under[1])[2]


def test_chains_beside_each_other_and_none_do_not_cross():
    assert crossings([], UP) == []
    assert crossings([straight([1, 0, 0], 0.0), Chain(S * [1, 0, 0] + [0, 0.02, 0], 0.004)], UP) == []
    assert crossings([Chain(S * [0, 0, 1], 0.004)], UP) == []


def test_long_chains_cross_too():
    s = np.linspace(-0.1, 0.1, 20_001)[:, None]
    (found,) = crossings([Chain(s * [1, 0, 0], 0.004), Chain(s * [0, 1, 0] + [0.02, 0, 0.01], 0.004)], UP)
    np.testing.assert_allclose(found.place, [0.02, 0, 0.005], atol=1e-9)


def test_the_side_that_is_seen():
    points = np.zeros((1, 3))
    np.testing.assert_allclose(side_seen(points, np.array([[1.0, 0, 1], [-3, 0, 3]])), UP, atol=1e-12)
    np.testing.assert_allclose(side_seen(points, np.array([[1.0, 0, 0], [-1, 0, 0]])), UP)
    np.testing.assert_allclose(side_seen(points, np.empty((0, 3))), UP)
