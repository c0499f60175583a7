"""What is known of the strings beforehand: how long they are, and whether they are rings."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import strand
from strand import bridges, linking
from strand.config import Config, Linking
from strand.known import Known, contradiction

R = 0.0042


def behind_a_plate(scene, low, high, z):
    """Views of a scene with a level plate at the height z, from one corner in x and y to the other."""
    views = []
    (fx, _, cx), (_, fy, cy), _ = scene.intrinsics
    for depth, pose, true in zip(scene.depth, scene.poses, scene.poses_true, strict=True):
        v, u = np.indices(depth.shape)
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=2) @ true[:3, :3].T
        plate = (z - true[2, 3]) / rays[..., 2]
        place = true[:2, 3] + plate[..., None] * rays[..., :2]
        seen = depth * scene.depth_scale
        hides = ((place > low) & (place < high)).all(axis=2) & ((seen == 0) | (plate < seen))
        views.append(strand.View.from_depth(np.where(hides, plate, seen), scene.intrinsics, pose))
    return views


def length_of(nodes):
    return strand.Chain(nodes, R).length


def farthest(chain, truth):
    """How far a chain's nodes are from a true centreline at most, in radii."""
    line = strand.Chain(truth, R)
    return max(line.nearest(point)[1] for point in chain.points) / R


@pytest.fixture(scope="module")
def hidden_bow():
    """A straight string with a bow of 3 cm in its middle, which a plate hides from one camera."""
    y = np.linspace(-0.15, 0.15, 601)
    x = np.where(np.abs(y) < 0.05, 0.03 * np.cos(np.pi * y / 0.1) ** 2, 0.0)
    truth = np.stack([x, y, np.full(len(y), R)], axis=1)
    scene = strand.synthetic.scene(chains=[truth], seed=2, views=1)
    return truth, behind_a_plate(scene, (-0.04, -0.05), (0.08, 0.05), 0.022), scene.bounds


def test_a_hidden_gap_is_bridged_by_as_much_string_as_is_missing(hidden_bow):
    truth, views, bounds = hidden_bow
    (straight,) = strand.reconstruct(views, R, bounds, ropes=1).chains
    model = strand.reconstruct(views, R, bounds, ropes=1, length=length_of(truth))
    (chain,) = model.chains
    assert straight.length < 0.95 * length_of(truth)
    assert chain.length == pytest.approx(length_of(truth), rel=1e-3)
    assert farthest(straight, truth) > 6.0
    assert farthest(chain, truth) < 1.5
    assert not any("known to be" in warning for warning in model.warnings)
    assert chain.bridged[np.abs(chain.points[:, 1]) < 0.03].all()
    low, high = bounds
    assert ((chain.points > low) & (chain.points < high)).all()


def test_a_known_length_changes_nothing_of_what_was_seen(hidden_bow):
    truth, views, bounds = hidden_bow
    (straight,) = strand.reconstruct(views, R, bounds, ropes=1).chains
    (chain,) = strand.reconstruct(views, R, bounds, ropes=1, length=length_of(truth)).chains
    seen = chain.points[np.abs(chain.points[:, 1]) > 0.065]
    assert max(straight.nearest(point)[1] for point in seen) < 0.1 * R


def test_a_lost_end_is_doubtful_and_the_warning_says_by_how_much():
    y = np.linspace(-0.15, 0.15, 601)
    truth = np.stack([0 * y, y, np.full(len(y), R)], axis=1)
    scene = strand.synthetic.scene(chains=[truth], seed=2, views=1)
    views = behind_a_plate(scene, (-0.04, 0.1), (0.08, 0.2), 0.022)
    before = strand.reconstruct(views, R, scene.bounds, ropes=1)
    model = strand.reconstruct(views, R, scene.bounds, ropes=1, length=0.3)
    (chain,) = model.chains
    np.testing.assert_array_equal(chain.points, before.chains[0].points)
    assert model.confidence < 0.05 * before.confidence
    short = round((0.3 - chain.length) * 1e3)
    assert short > 40
    assert model.warnings[-1] == (
        f"chain 0 is {chain.length * 1e3:.0f} mm long, {short} mm shorter than it is known to be"
    )


def test_no_bow_goes_where_cameras_saw_that_nothing_is():
    y = np.linspace(-0.15, 0.15, 601)
    truth = np.stack([0 * y, y, np.full(len(y), R)], axis=1)
    scene = strand.synthetic.scene(chains=[truth], seed=2, views=1)
    views = behind_a_plate(scene, (0.0, -0.05), (0.02, 0.05), 0.022)
    model = strand.reconstruct(views, R, scene.bounds, ropes=1, length=0.4)
    assert model.chains[0].length < 0.32
    assert any("known to be" in warning for warning in model.warnings)


@pytest.mark.parametrize("published", [False, True])
def test_a_right_length_is_no_news_and_a_wrong_one_is_warned_of(published):
    scene = strand.synthetic.scene("arc", seed=3)
    config = Config.published() if published else Config()
    plain = strand.reconstruct(scene.views, R, scene.bounds, ropes=1, config=config)
    true = length_of(scene.truth[0])
    for length in (true, [true]):
        model = strand.reconstruct(scene.views, R, scene.bounds, ropes=1, config=config, length=length)
        np.testing.assert_array_equal(model.chains[0].points, plain.chains[0].points)
        np.testing.assert_equal(model.confidence, plain.confidence)
        assert model.warnings == plain.warnings
    model = strand.reconstruct(scene.views, R, scene.bounds, ropes=1, config=config, length=0.9 * true)
    assert "longer than it is known to be" in model.warnings[-1]
    assert not model.confidence > 0.1


@pytest.mark.parametrize("half", [0.03, 0.045])
def test_lengths_say_which_pieces_go_together(half):
    """Two strings that cross under a plate: straight on, one would be much longer than the other."""

    def string(side, before, after, lift):
        y = np.linspace(-half - before, half + after, 500)
        t = np.clip(0.5 + 0.5 * y / half, 0.0, 1.0)
        x = 0.012 * side * (1.0 - 2.0 * t**3 * (10.0 - 15.0 * t + 6.0 * t * t))
        return np.stack([x, y, R + lift * np.sin(np.pi * t) ** 2], axis=1)

    truth = [string(1.0, 0.12, 0.05, 0.0), string(-1.0, 0.05, 0.12, 2.2 * R)]
    scene = strand.synthetic.scene(chains=truth, seed=2, views=1)
    views = behind_a_plate(scene, (-0.01, -half - 0.004), (0.08, half + 0.004), 0.045)
    for length in (None, [length_of(nodes) for nodes in truth]):
        model = strand.reconstruct(views, R, scene.bounds, ropes=2, length=length)
        crossed = [chain.points[0, 0] * chain.points[-1, 0] < 0 for chain in model.chains]
        assert crossed == [length is not None] * 2


def test_lengths_are_those_of_the_strings_that_they_fit_best():
    known = Known.given(None, [0.3, 0.5, 0.4])
    assert known.ropes == 3
    assert known.expected([0.31, 0.42, 0.49]) == [0.3, 0.4, 0.5]
    assert known.expected([0.41]) == [0.4]
    assert known.expected([0.1, 0.5, 0.4, 0.3]) == [None, 0.5, 0.4, 0.3]
    every = Known.given(2, np.float64(0.3))
    assert (every.ropes, every.expected([0.2, 0.1, 0.3])) == (2, [0.3, 0.3, 0.3])
    assert every.of_a_kind().expected([0.2]) == [0.3]
    assert known.of_a_kind().lengths == ()
    assert contradiction(0.305, 0.3, R) == 0.0
    assert contradiction(0.4, 0.3, 0.005) == pytest.approx(20.0 - 1.2 - 1.0)
    assert contradiction(0.4, None, R) == 0.0


def test_a_bridge_has_the_length_that_is_asked_for():
    before = np.linspace([-0.05, 0.0, 0.0], [0.0, 0.0, 0.0], 21)
    after = np.linspace([0.08, 0.01, 0.0], [0.13, 0.01, 0.0], 21)
    for length in (0.085, 0.095):
        nodes = bridges.least_bending(before, after, R, None, Linking(), length)
        way = np.vstack([before[-1:], nodes, after[:1]])
        assert length_of(way) == pytest.approx(length, rel=1e-6)
    box = (np.array([-1.0, -1.0, -0.002]), np.array([1.0, 0.014, 1.0]))
    nodes = bridges.least_bending(before, after, R, None, Linking(), 0.095, box)
    assert ((nodes > box[0]) & (nodes < box[1])).all()
    plain = bridges.least_bending(before, after, R, None, Linking())
    for length in (0.01, 0.15, 0.5):
        nodes = bridges.least_bending(before, after, R, None, Linking(), length)
        np.testing.assert_array_equal(nodes, plain)


def links_of(costs, count, rings):
    arcs = tuple(np.zeros((2, 3)) for _ in range(count))
    return linking.Links(arcs, costs, rings)


def test_without_rings_the_matching_is_the_cheapest_that_closes_none():
    rng = np.random.default_rng(0)
    closing = 0
    for _ in range(30):
        pairs = [(i, j) for i, j in combinations(range(8), 2) if i // 2 != j // 2]
        costs = {pair: float(rng.uniform(0.0, 9.0)) for pair in pairs}

        def search(k, chosen, costs=costs, pairs=pairs):
            if k == len(pairs):
                closed = any(ring for _, ring in linking.walk(4, chosen))
                cost = sum(costs[pair] for pair in chosen) + 5.0 * (8 - 2 * len(chosen))
                return np.inf if closed else cost
            best = search(k + 1, chosen)
            if not any(end in pair for pair in chosen for end in pairs[k]):
                best = min(best, search(k + 1, [*chosen, pairs[k]]))
            return best

        joins, cost = links_of(costs, 4, rings=False).matched(5.0)
        assert not any(ring for _, ring in linking.walk(4, joins))
        assert cost == pytest.approx(sum(costs[pair] for pair in joins) + 5.0 * (8 - 2 * len(joins)))
        assert cost == pytest.approx(search(0, []))
        closing += links_of(costs, 4, rings=True).matched(5.0)[1] < cost - 1e-9
    assert closing > 5


def test_many_rings_are_opened_in_time():
    costs = {}
    for k in range(60):
        costs[4 * k, 4 * k + 2] = costs[4 * k + 1, 4 * k + 3] = 1.0
    joins, cost = links_of(costs, 120, rings=False).matched(5.0)
    assert len(joins) == 60
    assert cost == pytest.approx(60 * 11.0)


def with_rings(views, bounds, rings, **known):
    return strand.reconstruct(views, R, bounds, config=Config(linking=Linking(rings=rings)), **known)


def test_rings_are_closed_or_not_as_the_caller_says():
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    ring = np.stack([0.06 * np.cos(angle), 0.06 * np.sin(angle), 0 * angle + R], axis=1)
    scene = strand.synthetic.scene(chains=[ring], seed=1, views=3)
    for rings in ("maybe", "always"):
        (chain,) = with_rings(scene.views, scene.bounds, rings).chains
        assert chain.closed
        assert chain.length == pytest.approx(0.12 * np.pi, rel=0.01)
    (chain,) = with_rings(scene.views, scene.bounds, "never").chains
    assert not chain.closed
    # a quarter of it hidden: too far to be joined without knowing that it is a ring
    views = behind_a_plate(scene, (-0.1, 0.0), (0.03, 0.1), 0.022)
    for rings in ("maybe", "never"):
        assert not with_rings(views, scene.bounds, rings).chains[0].closed
    for known in ({}, {"ropes": 1}, {"length": 0.12 * np.pi}):
        model = with_rings(views, scene.bounds, "always", **known)
        (chain,) = model.chains
        assert chain.closed
        assert chain.length == pytest.approx(0.12 * np.pi, rel=0.01)
        assert farthest(chain, ring) < 1.0


def test_a_string_that_was_seen_to_have_ends_is_no_ring():
    scene = strand.synthetic.scene("arc", seed=1, views=3)
    sure = with_rings(scene.views, scene.bounds, "never")
    model = with_rings(scene.views, scene.bounds, "always")
    assert not model.chains[0].closed
    assert model.warnings[-1] == "chain 0 has ends, though all strings are said to be rings"
    assert model.confidence < 0.6 < sure.confidence
