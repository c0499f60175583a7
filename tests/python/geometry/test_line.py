"""Lines: lengths, places, tangents and bends along nodes."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import draw_circle
from strand import Chain


@pytest.mark.parametrize("closed", [False, True])
def test_length_tangents_and_curvature_of_a_circle(closed):
    chain = draw_circle(0.05, 400, closed)
    around = 2 * np.pi * 0.05 * (1 if closed else 0.75)
    assert chain.length == pytest.approx(around, rel=1e-4)
    assert chain.arc_length[0] == 0
    assert len(chain.arc_length) == len(chain.tangents) == len(chain.curvature) == 400
    np.testing.assert_allclose(chain.curvature, 20.0, rtol=1e-3)
    outwards = chain.points / np.linalg.norm(chain.points, axis=1, keepdims=True)
    tangents = np.cross([0, 0, 1], outwards)
    inner = slice(None) if closed else slice(1, -1)
    np.testing.assert_allclose(chain.tangents[inner], tangents[inner], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(chain.tangents, axis=1), 1.0, atol=1e-12)


def test_coordinates_whose_products_overflow_are_refused():
    for far in (1e76, 1e300):
        with pytest.raises(ValueError, match="points: expected coordinates up to 1e"):
            Chain([[0.0, 0.0, 0.0], [1.0, far, 0.0], [2.0, 0.0, 0.0]], 0.1)
    near = Chain([[0.0, 0.0, 0.0], [1.0, 1e74, 0.0], [2.0, 0.0, 0.0]], 0.1)
    assert np.isfinite(near.tangents).all()
    assert np.isfinite(near.curvature).all()


def test_at_and_nearest_go_together():
    chain = draw_circle(0.05, 300, False)
    rng = np.random.default_rng(0)
    s = rng.uniform(0, chain.length, 20)
    near = chain.nearest(chain.at(s))
    np.testing.assert_allclose(near.s, s, atol=1e-9)
    np.testing.assert_allclose(near.distance, 0, atol=1e-9)
    points = rng.uniform(-0.1, 0.1, (20, 3))
    near = chain.nearest(points)
    np.testing.assert_allclose(near.point, chain.at(near.s), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(near.point - points, axis=1), near.distance, atol=1e-12)
    dense = chain.at(np.linspace(0, chain.length, 5000))
    assert (near.distance <= np.linalg.norm(dense - points[:, None], axis=2).min(axis=1) + 1e-12).all()
    np.testing.assert_array_equal(chain.at(chain.arc_length), chain.points)


def test_a_closed_chain_goes_round_and_an_open_one_is_held_at_its_ends():
    ring, arc = draw_circle(0.05, 100, True), draw_circle(0.05, 100, False)
    np.testing.assert_allclose(ring.at(ring.length + 0.01), ring.at(0.01), atol=1e-12)
    np.testing.assert_allclose(ring.at(ring.length), ring.points[0], atol=1e-12)
    np.testing.assert_array_equal(arc.at(arc.length + 1.0), arc.points[-1])
    np.testing.assert_array_equal(arc.at(-1.0), arc.points[0])
    middle_of_last_step = (ring.points[-1:] + ring.points[:1]) / 2
    assert ring.nearest(middle_of_last_step).distance[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("points", "radius", "message"),
    [
        (np.zeros((1, 3)), 0.01, "at least two nodes"),
        (np.zeros((2, 3)), 0.01, "no two equal nodes"),
        (np.array([[0.0, 0, 0], [np.nan, 0, 0]]), 0.01, "points: expected finite"),
        (np.array([[0.0, 0, 0], [1.0, 0, 0]]), 0.0, "radius"),
        (np.array([[0.0, 0, 0], [1.0, 0, 0]]), np.nan, "radius"),
    ],
)
def test_a_chain_that_makes_no_sense_is_refused(points, radius, message):
    with pytest.raises(ValueError, match=message):
        Chain(points, radius)


def test_two_nodes_make_a_straight_chain():
    chain = Chain(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0]]), 0.01)
    np.testing.assert_array_equal(chain.tangents, [[0, 0, 1], [0, 0, 1]])
    np.testing.assert_array_equal(chain.curvature, [0, 0])
    near = chain.nearest([[1.0, 0.0, 0.5]])
    assert (near.chain[0], near.s[0], near.distance[0]) == (0, 0.5, 1.0)


def test_a_reversed_chain_is_the_same_rope(paper_model):
    chain = paper_model.chains[0]
    back = chain.reversed()
    s = np.linspace(0.0, chain.length, 11)
    np.testing.assert_allclose(back.at(s), chain.at(chain.length - s), atol=1e-9)
    np.testing.assert_array_equal(back.points_seen[::-1], chain.points_seen)
    np.testing.assert_array_equal(back.reversed().points, chain.points)


def test_lists_are_kept_as_arrays():
    chain = Chain([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], 0.1, points_seen=[3, 0, 5])
    assert chain.points_seen.tolist() == [3, 0, 5]
    assert chain.bridged.tolist() == [False, True, False]
    with pytest.raises(ValueError, match="points_seen: expected counts, got negative numbers"):
        Chain(chain.points, 0.1, points_seen=[3, -1, 5])


@pytest.mark.parametrize("wrong", ["abc", [None], 1j, [[1.0], [1.0, 2.0]]])
def test_places_are_asked_for_by_numbers(wrong):
    chain = Chain([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], 0.1)
    with pytest.raises((TypeError, ValueError), match=r"^s: "):
        chain.at(wrong)
