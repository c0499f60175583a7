"""Contacts: strands near each other that do not cross."""

from __future__ import annotations

import numpy as np
import pytest

from shared.ropes import draw_circle
from strand import Chain, Model
from strand.ropes.clearance import find_nearest_on_segments
from strand.synthetic import random_ropes

R = 0.004
S = np.linspace(-0.1, 0.1, 101)[:, None]


def make_model(*chains):
    return Model(chains, np.eye(4)[None])


def draw_line(direction, shift=(0.0, 0.0, 0.0)):
    return Chain(S * direction + shift, R)


def test_strands_side_by_side_touch_along_the_stretch_that_they_share():
    beside = make_model(draw_line([1, 0, 0]), draw_line([1, 0, 0], [0.02, 2 * R + 0.0005, 0]))
    (found,) = beside.contacts(0.001)
    assert (found.first[0], found.second[0]) == (0, 1)
    assert found.gap == pytest.approx(0.0005)
    # the far ends' tubes are as near as their nearest places
    assert found.stretch_first == pytest.approx((0.02, 0.2), abs=R)
    assert found.stretch_second == pytest.approx((0.0, 0.18), abs=R)
    np.testing.assert_allclose(beside.chains[0].at(found.first[1]), found.point_first, atol=1e-12)
    assert str(found).startswith("chain 0 at ")
    assert beside.contacts(0.0004) == ()


def test_two_nodes_are_as_good_as_many():
    (found,) = make_model(
        Chain([[0.0, 0, 0], [1.0, 0, 0]], R), Chain([[0.7, -0.2, 0], [0.7, -0.009, 0]], R)
    ).contacts(0.002)
    assert found.first == (0, pytest.approx(0.7))
    assert found.second == (1, pytest.approx(0.191))
    assert found.gap == pytest.approx(0.001)


@pytest.mark.parametrize("angle", [0.2, 0.6, 1.2])
def test_strands_that_cross_are_no_contact(angle):
    crossing = make_model(draw_line([1, 0, 0]), draw_line([np.cos(angle), np.sin(angle), 0], [0, 0, 2 * R]))
    assert len(crossing.crossings()) == 1
    assert crossing.contacts(0.003) == ()
    # from the side they do not cross: they touch
    assert len(crossing.contacts(0.003, direction=(0, 1, 0))) == 1


def test_strands_that_cross_and_touch_elsewhere_do_both():
    t = np.linspace(0.0, 1.0, 200)
    # over the line, and back beside it
    back = np.array(
        [[-0.05, -0.05, 2 * R], [-0.05, 0.05, 2 * R], [0.06, 0.05, 0], [0.06, 2.1 * R, 0], [0.09, 2.1 * R, 0]]
    )
    knots = np.linspace(0.0, 1.0, len(back))
    path = np.stack([np.interp(t, knots, column) for column in back.T], axis=1)
    both = make_model(draw_line([1, 0, 0]), Chain(path, R))
    assert len(both.crossings()) == 1
    (found,) = both.contacts(0.001)
    assert found.first[1] == pytest.approx(0.175, abs=0.02)
    assert found.gap == pytest.approx(0.1 * R)


def draw_beside_after_crossing(slope):
    """Return a strand that crosses the x axis, then runs beside it, 0.1 radii away, for almost 0.5 m."""
    x = np.linspace(-0.2, 0.5, 1401)
    there = 2.1 * R / slope
    height = np.interp(x, [-0.2, 0.6 * there, there + 0.01, 0.5], [2 * R, 2 * R, 0, 0])
    return make_model(
        Chain(np.stack([x, 0 * x, 0 * x], axis=1), R),
        Chain(np.stack([x, np.minimum(slope * x, 2.1 * R), height], axis=1), R),
    )


@pytest.mark.parametrize("distance", [0.001, 0.003, 0.01, 0.03, 0.1])
@pytest.mark.parametrize(("slope", "shortest"), [(1.0, 0.45), (0.3, 0.38), (0.1, 0.2)])
def test_strands_that_cross_and_then_lie_side_by_side_do_both(slope, shortest, distance):
    both = draw_beside_after_crossing(slope)
    assert len(both.crossings()) == 1
    (found,) = both.contacts(distance)
    assert found.gap == pytest.approx(0.1 * R, abs=1e-6)
    start, stop = found.stretch_first
    assert stop - start > shortest
    assert stop == pytest.approx(0.7, abs=R)


def test_what_a_distance_finds_a_larger_one_finds_too():
    scenes = [
        Model(tuple(Chain(points, R) for points in random_ropes(3, 3, R, seed)), np.eye(4)[None])
        for seed in (2, 6, 7)
    ]
    for scene in (*scenes, draw_beside_after_crossing(0.5)):
        fewer = ()
        for distance in (0.001, 0.003, 0.01, 0.02, 0.05):
            more = [one for one in scene.contacts(distance) if one.first[0] != one.second[0]]
            for small in fewer:
                assert any(
                    (small.first[0], small.second[0]) == (large.first[0], large.second[0])
                    and large.stretch_first[0] <= small.first[1] <= large.stretch_first[1]
                    and large.stretch_second[0] <= small.second[1] <= large.stretch_second[1]
                    for large in more
                )
            fewer = more
        assert fewer


def test_a_ring_that_crosses_itself_at_its_seam_is_no_contact():
    # a figure of eight, which crosses itself a little before and after where its points start
    for start in (-0.05, -0.01, 0.0, 0.01, 0.05, 1.0):
        t = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False) + start
        eight = Chain(np.stack([0.1 * np.sin(t), 0.05 * np.sin(2 * t), R * np.cos(t)], axis=1), R, True)
        assert len(eight.crossings()) == 1
        assert make_model(eight).contacts(0.003) == ()


def test_the_legs_of_a_bend_touch_and_a_bend_does_not():
    t = np.linspace(0.0, np.pi, 40)[1:-1]
    out = np.linspace(-0.1, 0.0, 60)
    legs = [np.stack([out, 0 * out - 1.05 * R], axis=1), 1.05 * R * np.stack([np.sin(t), -np.cos(t)], axis=1)]
    legs.append(legs[0][::-1] * [1, -1])
    hairpin = Chain(np.column_stack([np.concatenate(legs), np.zeros(158)]), R)
    (found,) = make_model(hairpin).contacts(0.001)
    assert found.first[0] == found.second[0] == 0
    assert found.gap == pytest.approx(0.1 * R, rel=0.01)
    assert found.second[1] - found.first[1] > np.pi * R
    assert make_model(draw_circle(0.05, 300, True)).contacts(0.001) == ()
    assert make_model(draw_circle(0.05, 300, True)).contacts(1.0) == ()


def test_a_contact_over_the_seam_of_a_ring_is_one():
    ring = draw_circle(0.05, 300, True)
    tangent = Chain(np.stack([np.full(101, 0.05 + 2.05 * R), S[:, 0], 0 * S[:, 0]], axis=1), R)
    (found,) = make_model(ring, tangent).contacts(0.001)
    start, stop = found.stretch_first
    assert start < 0 < stop or start < ring.length < stop
    assert stop - start < 0.05


def test_nearest_places_of_segments_against_a_search():
    rng = np.random.default_rng(0)
    a, b, c, d = rng.normal(size=(4, 50, 3))
    b[0], d[0] = a[0] + [1, 0, 0], c[0] + [2, 0, 0]
    shares, away = find_nearest_on_segments(a, b, c, d)
    s = np.linspace(0, 1, 201)[:, None]
    for k in range(50):
        p, q = a[k] + s * (b[k] - a[k]), c[k] + s * (d[k] - c[k])
        assert away[k] <= np.linalg.norm(p[:, None] - q, axis=2).min() + 1e-12
        ends = a[k] + shares[0, k] * (b[k] - a[k]), c[k] + shares[1, k] * (d[k] - c[k])
        assert np.linalg.norm(ends[0] - ends[1]) == pytest.approx(away[k])


def test_distances_that_make_no_sense_are_refused():
    assert make_model().contacts(0.01) == ()
    for distance in (-0.001, np.nan, np.inf):
        with pytest.raises(ValueError, match="distance"):
            make_model(draw_line([1, 0, 0])).contacts(distance)
    with pytest.raises(ValueError, match="direction"):
        make_model(draw_line([1, 0, 0])).contacts(0.001, direction=(0, 0, 0))
