"""Crossings of chains: places, order and probability."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R
from strand import Chain, Model
from strand.ropes.crossings import Crossing, list_crossings
from strand.ropes.doubt import Doubt
from strand.synthetic import random_ropes, shape

UP = np.array([0.0, 0.0, 1.0])
S = np.linspace(-0.1, 0.1, 41)[:, None]


def make_model(*chains, doubts=()):
    return Model(chains, np.eye(4)[None], doubts=doubts)


def make_straight(direction, height, sd=None):
    covariance = None if sd is None else np.tile(sd**2 * np.eye(3), (len(S), 1, 1))
    return Chain(S * direction + [0.003, 0.001, height], R, covariance=covariance)


def make_trefoil(count=300):
    """Return a right-handed trefoil as a ring."""
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    away = 2 + np.cos(3 * t)
    return Chain(
        0.03 * np.stack([away * np.cos(2 * t), away * np.sin(2 * t), -np.sin(3 * t)], axis=1), R, closed=True
    )


def draw_rotation(seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return turn * np.sign(np.linalg.det(turn))


def move_chain(chain, turn, shift, scale=1.0):
    covariance = None if chain.covariance is None else scale**2 * turn @ chain.covariance @ turn.T
    return Chain(scale * chain.points @ turn.T + shift, scale * chain.radius, chain.closed, None, covariance)


def list_numbers(crossings):
    """Return (K, 9) the values of crossings without the points."""
    return np.array(
        [(*c.over, *c.under, c.height, c.gap, c.angle, c.sign, c.probability) for c in crossings]
    ).reshape(-1, 9)


@pytest.mark.parametrize(("towards", "over"), [((0, 0, 1), 1), (-3 * UP, 0)])
def test_who_is_over_whom_and_where(towards, over):
    low, high = make_straight([1, 0, 0], 0.0), make_straight([0.6, 0.8, 0], 0.01)
    (found,) = make_model(low, high).crossings(towards)
    assert (found.over[0], found.under[0]) == (over, 1 - over)
    np.testing.assert_allclose(found.place, [0.003, 0.001, 0.005], atol=1e-9)
    assert found.point_over[2] == pytest.approx(0.01 * over)
    assert found.over[1] == found.under[1] == pytest.approx(0.1)
    assert found.height == pytest.approx(0.01)
    assert found.gap == pytest.approx(0.01 - 2 * R)
    assert found.angle == pytest.approx(np.arccos(0.6))
    # to run as the lower strand the upper one turns to the right, from above and from below
    assert found.sign == -1
    assert str(found).startswith(f"chain {over} at 100 mm passes over chain {1 - over} at 100 mm")


def test_a_right_handed_trefoil_has_three_positive_crossings():
    chain = make_trefoil()
    found = chain.crossings()
    assert [c.sign for c in found] == [1, 1, 1]
    mirrored = Chain(chain.points * [1, 1, -1], R, closed=True)
    assert [c.sign for c in mirrored.crossings()] == [-1, -1, -1]
    for c in found:
        np.testing.assert_allclose(chain.at(c.over[1]), c.point_over, atol=1e-12)
        np.testing.assert_allclose(chain.at(c.under[1]), c.point_under, atol=1e-12)
        np.testing.assert_allclose(c.point_over[:2], c.point_under[:2], atol=1e-8)
        assert c.point_over[2] > c.point_under[2]
    # over and under in turn
    passes = sorted([(c.over[1], 1) for c in found] + [(c.under[1], 0) for c in found])
    assert [up for _, up in passes] in ([0, 1] * 3, [1, 0] * 3)
    firsts = [min(c.over[1], c.under[1]) for c in found]
    assert firsts == sorted(firsts)


@pytest.mark.parametrize("name", ["loop", "figure8", "overhand", "paper"])
def test_named_shapes_cross_as_they_are_known_to(name):
    count = {"loop": 1, "figure8": 2, "overhand": 3, "paper": 3}[name]
    found = Chain(shape(name), R).crossings()
    assert len(found) == count
    assert all(c.gap > -0.02 * R for c in found)
    if name == "overhand":
        assert abs(sum(c.sign for c in found)) == 3


def find_least_distance(one, other):
    """Return the least distance of the surfaces of two chains of radius R, from many places."""
    return one.signed_distance(other.at(np.linspace(0, other.length, 20_001))).min() - R


@pytest.mark.parametrize("rise", [0.03, 0.05, 0.1])
def test_gap_of_a_strand_that_climbs_is_that_of_the_surfaces(rise):
    y = np.linspace(-0.1, 0.1, 801)
    climbs = Chain(np.stack([0 * y, y, 3 * R + rise / (1 + np.exp(-y / 0.0025))], axis=1), R)
    line = Chain(S * [1, 0, 0] + [0, 0, R], R)
    (found,) = make_model(line, climbs).crossings()
    assert found.height > 0.018
    assert found.gap == pytest.approx(find_least_distance(line, climbs), abs=0.03 * R)


@pytest.mark.parametrize("tilt", [1, 0.1, 0.003])
@pytest.mark.parametrize("across", [0.0, 1.0])
def test_gap_of_an_end_that_stands_up_is_that_of_the_end(tilt, across):
    foot = tilt * np.array([0.05 * (1 - across), 0.05 * across + 0.003, 0])
    stands = Chain(np.array([[0, 0, 0.1], [0, 0, 0.03]]) + np.outer([-1, 1], foot), R)
    line = Chain(S * [1, 0, 0], R)
    (found,) = make_model(line, stands).crossings()
    assert found.gap == pytest.approx(find_least_distance(line, stands), abs=1e-6)


def test_gap_at_a_seam_is_that_anywhere_else():
    gaps = []
    for first in (0, 20, 217):
        ring = Chain(np.roll(make_trefoil().points, -first, axis=0), R, closed=True)
        found = ring.crossings()
        gaps.append(sorted(c.gap for c in found))
        assert min(gaps[-1]) > 0
    np.testing.assert_allclose(gaps[1:], [gaps[0]] * 2, atol=0.01 * R)


def test_gap_of_a_small_loop_is_not_that_to_the_rope_beside_it():
    turn = np.linspace(0, 2 * np.pi, 200)
    for radius in (1.5 * R, 2 * R, 4 * R):
        loop = np.stack([radius * np.sin(turn), radius * (1 - np.cos(turn)), 3 * R * turn / turn[-1]], axis=1)
        out = np.linspace(0.02, 1e-4, 30)[:, None] * [1, 0, 0]
        chain = Chain(np.vstack([loop[0] - out, loop, loop[-1] + out[::-1]]), R)
        s = np.linspace(0, chain.length, 1000)
        away = np.linalg.norm(chain.at(s)[:, None] - chain.at(s), axis=2)
        least = away[np.abs(s[:, None] - s) > 6 * R].min() - 2 * R
        (found,) = chain.crossings()
        assert found.gap == pytest.approx(least, abs=0.01 * R)


def find_by_brute_force(chains):
    """Return all crossings seen from above, by pairs of segments: chains, arc lengths, which is higher."""
    pieces = []
    for i, chain in enumerate(chains):
        path = np.vstack([chain.points, chain.points[:1]]) if chain.closed else chain.points
        at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
        pieces += [
            (i, k, len(path) - 1, chain.closed, *path[k : k + 2], *at[k : k + 2])
            for k in range(len(path) - 1)
        ]
    found = []
    for m, (i, k, count, closed, a, b, s0, s1) in enumerate(pieces):
        for j, n, _, _, c, d, t0, t1 in pieces[m + 1 :]:
            if i == j and (abs(k - n) <= 1 or (closed and abs(k - n) == count - 1)):
                continue
            try:
                t, u = np.linalg.solve(np.column_stack([(b - a)[:2], (c - d)[:2]]), (c - a)[:2])
            except np.linalg.LinAlgError:
                continue
            s, v = s0 + t * (s1 - s0), t0 + u * (t1 - t0)
            around = abs(v - s) if not closed else min(abs(v - s), chains[i].length - abs(v - s))
            if 0 < t < 1 and 0 < u < 1 and not (i == j and around < 4 * chains[i].radius):
                found.append((i, s, j, v, (a + t * (b - a))[2] > (c + u * (d - c))[2]))
    return found


@pytest.mark.parametrize("seed", [1, 4])
def test_every_crossing_is_found_that_brute_force_finds(seed):
    chains = [Chain(nodes[::3], R) for nodes in random_ropes(seed, 2, R, seed)]
    chains.append(Chain(make_trefoil(60).points, 0.5 * R, closed=True))
    found = make_model(*chains).crossings()
    first = [(*c.over, *c.under, True) if c.over < c.under else (*c.under, *c.over, False) for c in found]
    expected = sorted(find_by_brute_force(chains))
    assert len(expected) > 5
    np.testing.assert_allclose(first, expected, atol=1e-8)


def test_smooth_curves_meet_where_the_curves_do(paper_model):
    chain = paper_model.chains[0]
    found = chain.crossings()
    assert len(found) == 3
    for c in found:
        np.testing.assert_allclose(c.point_over[:2], c.point_under[:2], atol=1e-9)
        assert 0 < c.height_sd < 0.5 * R
        assert c.probability > 0.99


@pytest.mark.parametrize("seed", range(3))
def test_crossings_move_with_the_ropes_and_grow_with_them(seed):
    ropes = [
        Chain(nodes, R, covariance=np.tile(1e-8 * np.eye(3), (len(nodes), 1, 1)))
        for nodes in random_ropes(3, 2, R, 5)
    ]
    before = make_model(*ropes).crossings()
    turn, shift = draw_rotation(seed), np.array([0.3, -0.2, 1.0])
    after = make_model(*(move_chain(chain, turn, shift) for chain in ropes)).crossings(turn @ UP)
    np.testing.assert_allclose(list_numbers(after), list_numbers(before), atol=1e-7)
    np.testing.assert_allclose([c.place for c in after], [turn @ c.place + shift for c in before], atol=1e-7)
    larger = make_model(*(move_chain(chain, np.eye(3), 0.0, 1e3) for chain in ropes)).crossings()
    lengths = np.array([1, 1e3, 1, 1e3, 1e3, 1e3, 1, 1, 1])
    np.testing.assert_allclose(list_numbers(larger), list_numbers(before) * lengths, atol=1e-4)


def test_from_the_other_side_the_same_strands_cross_the_other_way_round():
    chains = [Chain(nodes, R) for nodes in random_ropes(4, 2, R, 2)]
    above, below = (make_model(*chains).crossings(side) for side in (UP, -UP))
    assert len(above) == len(below) >= 4
    for one, other in zip(above, below, strict=True):
        np.testing.assert_allclose([one.over, one.under], [other.under, other.over], atol=1e-8)
        np.testing.assert_allclose(
            [one.height, one.gap, one.angle], [other.height, other.gap, other.angle], atol=1e-8
        )
        assert one.sign == other.sign


def test_a_reversed_chain_crosses_itself_with_the_same_signs_and_others_with_the_opposite():
    chains = [Chain(nodes, R) for nodes in random_ropes(4, 2, R, 2)]
    before = make_model(*chains).crossings()
    after = make_model(chains[0].reversed(), chains[1]).crossings()

    def told(crossings, turned):
        rows = []
        for c in crossings:
            (i, s), (j, t) = c.over, c.under
            s, t = (chains[0].length - x if turned and k == 0 else x for k, x in ((i, s), (j, t)))
            rows.append((i, j, round(s, 6), round(t, 6), c.sign * (-1 if turned and i != j else 1)))
        return sorted(rows)

    assert {c.over[0] == c.under[0] for c in before} == {True, False}
    assert told(after, True) == told(before, False)


def test_chains_beside_each_other_across_the_view_and_none_do_not_cross():
    assert make_model().crossings() == ()
    assert make_model(make_straight([1, 0, 0], 0.0), Chain(S * [1, 0, 0] + [0, 0.02, 0], R)).crossings() == ()
    assert make_model(Chain(S * [0, 0, 1], R)).crossings() == ()
    assert Chain([[0.0, 0, 0], [1.0, 0, 0]], R).crossings() == ()


def test_strands_that_touch_in_the_plan_only_do_not_cross():
    bow = Chain([[-0.1, 0.1, 0.01], [0.0, 0.0, 0.01], [0.1, 0.1, 0.01]], R)
    for low in (-0.05, 0.0, 0.1):
        line = Chain([[-0.1, 0.0, 0.0], [low, 0.0, 0.0], [0.2, 0.0, 0.0]], R)
        assert make_model(bow, line).crossings() == ()
        assert make_model(line, bow).crossings() == ()


def test_near_parallel_strands_that_cross_twice_cross_twice():
    s = np.linspace(-0.1, 0.1, 201)
    line = Chain(np.stack([s, 0 * s, 0 * s], axis=1), R)
    bow = Chain(np.stack([s, 10.0 * s**2 - 0.2 * R, 0 * s + 2.02 * R], axis=1), R)
    found = make_model(line, bow).crossings()
    assert [c.over[0] for c in found] == [1, 1]
    assert [c.sign for c in found] == [1, -1] or [c.sign for c in found] == [-1, 1]
    assert found[1].over[1] - found[0].over[1] == pytest.approx(2 * np.sqrt(0.02 * R), rel=0.02)
    assert max(c.angle for c in found) < 0.25


def test_a_kink_within_a_bend_is_no_crossing():
    t = np.linspace(-1.0, 1.0, 41)
    # a curl of a strand that climbs: its plan has a loop
    for size, count in ((0.5 * R, 0), (4.0 * R, 1)):
        curl = size * np.stack([t**3 - 0.3 * t, t**2, 3 * t], axis=1)
        assert len(Chain(curl, R).crossings()) == count


def test_a_hundred_thousand_nodes_lose_no_crossing():
    t = np.linspace(0, 1, 100_001)
    weave = 0.5 * np.stack(
        [np.sin(2 * np.pi * 7 * t), np.sin(2 * np.pi * 9 * t + 0.4), 0.01 * np.sin(40 * t)], axis=1
    )
    found = Chain(weave, 1e-4).crossings()
    # of a Lissajous figure of 7 and 9: 2 * 7 * 9 - 7 - 9
    assert len(found) == 2 * 7 * 9 - 7 - 9
    # no file lists them: chains of noise have millions
    assert list_crossings([Chain(weave, 1e-4)], UP, ()) is None
    assert len(list_crossings([Chain(weave[::20], 1e-4)], UP, ())) == len(found)


def test_a_height_without_covariance_has_no_deviation():
    (found,) = make_model(make_straight([1, 0, 0], 0.0), make_straight([0, 1, 0], 0.01)).crossings()
    assert np.isnan(found.height_sd)
    (found,) = make_model(
        make_straight([1, 0, 0], 0.0, 3e-4), make_straight([0, 1, 0], 0.01, 4e-4)
    ).crossings()
    assert found.height_sd == pytest.approx(5e-4)


def test_strands_seen_at_a_slant_are_as_far_apart_as_they_are():
    # straight strands, 0.01 apart along z, seen from a slant: the axes' distance stays
    low, high = make_straight([1, 0, 0], 0.0, 3e-4), make_straight([0, 1, 0], 0.01, 4e-4)
    (found,) = make_model(low, high).crossings([0.5, 0.3, 1.0])
    assert found.gap == pytest.approx(0.01 - 2 * R)
    assert found.height == pytest.approx(0.01 * np.linalg.norm([0.5, 0.3, 1.0]))
    assert found.height_sd == pytest.approx(5e-4 * np.linalg.norm([0.5, 0.3, 1.0]))


def find_probability(height, sd, doubts=()):
    (found,) = make_model(
        make_straight([1, 0, 0], 0.0, sd), make_straight([0, 1, 0], height, sd), doubts=doubts
    ).crossings()
    return found.probability


def test_the_order_is_surer_the_farther_apart_and_the_less_noise():
    by_height = [find_probability(height, 1e-3) for height in (0.0, 0.2 * R, R, 2 * R)]
    assert by_height[0] < 0.5
    assert by_height == sorted(by_height)
    assert by_height[-1] > 0.97
    by_noise = [find_probability(1.5 * R, sd) for sd in (10 * R, R, 0.3 * R, 0.05 * R)]
    assert by_noise == sorted(by_noise)
    assert by_noise[0] < 0.6


def test_strands_that_cut_into_each_other_are_not_sure_however_narrow_the_noise():
    # neither order leaves two ropes so near each other
    assert find_probability(0.2 * R, 1e-5) < 0.65


@pytest.mark.parametrize("kind", ["order", "rival"])
def test_doubts_at_a_crossing_lower_it_and_others_hardly(kind):
    here, there = ([Doubt(kind, 0.6, "it", "so", place)] for place in ([0.003, 0.001, 0], [0.9, 0.0, 0.0]))
    sure = find_probability(2 * R, 1e-4)
    assert find_probability(2 * R, 1e-4, here) < sure
    assert find_probability(2 * R, 1e-4, there) == pytest.approx(sure)


@pytest.mark.parametrize(
    ("direction", "message"),
    [((0, 0, 0), "not zero"), ((0, np.nan, 1), "finite"), ((1, 0), "shape"), (1.0, "shape")],
)
def test_directions_that_say_nothing_are_refused(direction, message):
    with pytest.raises(ValueError, match=f"direction: .*{message}"):
        make_model(make_trefoil()).crossings(direction)
    with pytest.raises(TypeError, match="direction"):
        make_model(make_trefoil()).crossings("up")


def test_stretches_between_crossings():
    low, high = make_straight([1, 0, 0], 0.0), make_straight([0, 1, 0], 0.01)
    both = make_model(low, high)
    assert both.segment_between_crossings(0, 0.03) == pytest.approx((0.0, 0.1))
    assert both.segment_between_crossings(1, 0.15) == pytest.approx((0.1, 0.2))
    assert make_model(low).segment_between_crossings(0, 0.15) == pytest.approx((0.0, 0.2))
    ring = make_model(make_trefoil())
    passes = sorted(at[1] for c in ring.crossings() for at in (c.over, c.under))
    start, stop = ring.segment_between_crossings(0, 0.0)
    length = ring.chains[0].length
    assert (start, stop) == pytest.approx((passes[-1] - length, passes[0]))
    for s in (-0.01, 0.21, np.nan):
        with pytest.raises(ValueError, match="s: expected"):
            both.segment_between_crossings(0, s)
    with pytest.raises(ValueError, match="chain: expected at most 1"):
        both.segment_between_crossings(2, 0.1)
    with pytest.raises(ValueError, match=r"chain: expected .* the model has no chains"):
        make_model().segment_between_crossings(0, 0.0)


def test_a_crossing_that_makes_no_sense_is_refused():
    places = {"over": (0, 0.1), "under": (1, 0.2), "point_over": [0, 0, 1], "point_under": [0, 0, 0]}
    said = {
        **places,
        "height": 1.0,
        "height_sd": None,
        "gap": 0.5,
        "angle": 1.0,
        "sign": 1,
        "probability": 0.9,
    }
    assert np.isnan(Crossing(**said).height_sd)
    for name, value in (("over", (0, np.nan)), ("sign", 0), ("probability", 1.5), ("point_over", [0, 0])):
        with pytest.raises(ValueError, match=name):
            Crossing(**{**said, name: value})


def test_saved_models_say_their_crossings(tmp_path, paper_model):
    path = tmp_path / "model.json"
    paper_model.save(path)
    again = strand.load_model(path)
    np.testing.assert_array_equal(list_numbers(again.crossings()), list_numbers(paper_model.crossings()))
