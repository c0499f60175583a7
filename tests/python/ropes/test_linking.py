"""How often ropes wind round each other: against crossings counted in a view, and known links."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R


def ring(centre=(0.0, 0.0, 0.0), upright=False, nodes=50):
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=False)
    flat = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return (flat[:, [0, 2, 1]] if upright else flat) + centre


def winding(times, nodes=400):
    """A ring that winds round `ring()` so many times as a right-handed screw does."""
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=False)
    around = 1 + 0.3 * np.cos(times * angle)
    return np.stack([around * np.cos(angle), around * np.sin(angle), -0.3 * np.sin(times * angle)], axis=1)


def signs_between(a, b):
    """Sum of the signs of the crossings of two closed polylines seen along z, where a is above."""
    total = 0
    for p, q in zip(a, np.roll(a, -1, axis=0), strict=True):
        for r, s in zip(b, np.roll(b, -1, axis=0), strict=True):
            along, across, apart = q - p, s - r, r - p
            size = along[0] * across[1] - along[1] * across[0]
            t = (apart[0] * across[1] - apart[1] * across[0]) / size
            u = (apart[0] * along[1] - apart[1] * along[0]) / size
            if 0 < t < 1 and 0 < u < 1 and p[2] + t * along[2] > r[2] + u * across[2]:
                total += 1 if size > 0 else -1
    return total


@pytest.mark.parametrize("times", [-3, -1, 0, 1, 2, 5])
def test_rings_that_wind_round_each_other(times):
    assert strand.linking_number(ring(), winding(times)) == times
    assert strand.linking_number(winding(times), ring()) == times
    assert strand.linking_number(ring()[::-1], winding(times)) == -times
    assert strand.linking_number(ring() * [1, 1, -1], winding(times) * [1, 1, -1]) == -times


def test_random_polygons_are_linked_as_their_crossings_say():
    rng = np.random.default_rng(2)
    numbers = set()
    for _ in range(15):
        a, b = rng.normal(size=(2, 12, 3))
        found = strand.linking_number(a, b)
        assert found == signs_between(a, b) == signs_between(b, a)
        numbers.add(found)
    assert len(numbers) > 2


def test_chains_know_whether_they_are_closed():
    flat, linked = ring(), ring((1.0, 0.0, 0.0), upright=True)
    number = strand.linking_number(flat, linked)
    assert abs(number) == 1
    closed = [strand.Chain(nodes, 0.1, True) for nodes in (flat, linked)]
    assert strand.linking_number(*closed) == strand.linking_number(closed[0], linked) == number
    # an open chain lacks its last step: the integral is no whole number
    cut = strand.Chain(linked, 0.1)
    open_one = strand.linking_number(closed[0], cut)
    assert 0.5 < open_one * number < 1
    assert strand.linking_number(flat, linked, closed=False) != open_one


def test_a_long_straight_rope_through_a_ring():
    line = [[0.1, 0.0, -1e3], [0.0, 0.1, 1e3]]
    through = strand.linking_number(strand.Chain(ring(), R, True), strand.Chain(line, R))
    assert abs(through) == pytest.approx(1.0, abs=1e-4)
    beside = strand.linking_number(
        strand.Chain(ring(), R, True), strand.Chain([[5, 0, -9.0], [5, 0, 9.0]], R)
    )
    assert beside == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (ring()[:2], ring(), "a: expected at least three nodes of a closed chain, got 2"),
        (ring(), np.vstack([ring(), ring()[:1]]), "b: expected a closed chain without its first node"),
        (ring(), np.zeros((4, 3)), "b: expected no two equal nodes in a row"),
        (ring() * [1, np.nan, 1], ring(), "a"),
        (ring(), ring()[:, :2], "b"),
        (ring(nodes=20_000), ring(nodes=20_000) + 3, "b: expected at most 100000000 pairs"),
    ],
)
def test_what_is_no_rope_is_refused(a, b, message):
    with pytest.raises(ValueError, match=message):
        strand.linking_number(a, b)


def test_a_flag_is_a_flag():
    with pytest.raises(TypeError, match="closed"):
        strand.linking_number(ring(), ring() + 3, closed="both")
