"""Split at crossings, reconnect, and whole strings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strand import strings, topology
from strand.config import Reconnection, Splitting

RADIUS = 0.004


def straight(start: tuple[float, ...], end: tuple[float, ...], spacing: float = RADIUS) -> np.ndarray:
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    count = int(np.linalg.norm(b - a) / spacing) + 1
    return a + np.linspace(0, 1, count)[:, None] * (b - a)


def cross(angle: float = np.pi / 2) -> list[np.ndarray]:
    """Two straight chains, the second two radii above the first, that cross in the middle."""
    along = 0.05 * np.array([np.cos(angle), np.sin(angle), 0.0])
    up = np.array([0, 0, 2 * RADIUS])
    return [straight((-0.05, 0, 0), (0.05, 0, 0)), straight(tuple(up - along), tuple(up + along))]


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.integers(1, 3), st.booleans())
def test_separation_is_the_least_distance_outside_the_neighbourhood(seed, count, closed):
    rng = np.random.default_rng(seed)
    chains = [np.cumsum(rng.normal(size=(rng.integers(2, 30), 3)), axis=0) for _ in range(count)]
    found = topology.separation(chains, 3.0, [closed] * count)
    for i, chain in enumerate(chains):
        s = topology.path_length(chain)
        around = s[-1] + np.linalg.norm(chain[0] - chain[-1])
        for a in range(len(chain)):
            least = np.inf
            for j, other in enumerate(chains):
                for b in range(len(other)):
                    apart = abs(s[a] - s[b]) if i == j else np.inf
                    if i == j and closed:
                        apart = min(apart, around - apart)
                    if apart > 3.0:
                        least = min(least, np.linalg.norm(chain[a] - other[b]))
            assert found[i][a] == pytest.approx(least)


def test_a_crossing_cuts_both_strands_once_and_the_right_ends_are_joined():
    parts = topology.split(cross(), RADIUS, Splitting())
    assert len(parts.segments) == 4
    assert [len(nodes) for nodes in parts.cuts] == [1, 1]
    joined = topology.reconnect(parts, RADIUS, None, Reconnection())
    assert sorted(map(sorted, joined.joins)) == [[1, 2], [5, 6]]
    axis = np.concatenate([straight(tuple(c[0]), tuple(c[-1]), 0.0002) for c in cross()])
    found = strings.assemble(parts.segments, joined, axis, RADIUS, Reconnection())
    assert [closed for _, closed in found] == [False, False]
    for (nodes, _), chain in zip(sorted(found, key=lambda s: s[0][:, 2].mean()), cross(), strict=True):
        first, last = sorted([nodes[0].tolist(), nodes[-1].tolist()])
        np.testing.assert_allclose(
            [first, last], sorted([chain[0].tolist(), chain[-1].tolist()]), atol=RADIUS / 4
        )
        # every node lies on the straight line through its strand
        offset = np.cross(nodes - chain[0], (chain[-1] - chain[0]) / np.linalg.norm(chain[-1] - chain[0]))
        assert np.abs(offset).max() < 1e-9


@pytest.mark.parametrize("degrees", [45, 70, 90, 110, 135])
def test_pairs_follow_direction_at_any_steep_angle(degrees):
    parts = topology.split(cross(np.radians(degrees)), RADIUS, Splitting())
    joined = topology.reconnect(parts, RADIUS, None, Reconnection())
    assert sorted(map(sorted, joined.joins)) == [[1, 2], [5, 6]]


def test_noise_is_not_cut_and_neither_is_an_end_near_another_strand():
    noise = np.random.default_rng(0).normal(scale=0.05, size=200)
    assert len(topology.crossing_nodes(2.5 + noise, 3.2, 0.75)) == 0
    falling_to_an_end = np.linspace(6, 1, 30)
    assert len(topology.crossing_nodes(falling_to_an_end, 3.2, 0.75)) == 0
    valley = np.abs(np.arange(-20, 21)) * 0.3 + 1.0
    np.testing.assert_array_equal(topology.crossing_nodes(valley, 3.2, 0.75), [20])
    two = np.minimum(np.abs(np.arange(60) - 15), np.abs(np.arange(60) - 40)) * 0.2 + 1.0
    np.testing.assert_array_equal(topology.crossing_nodes(two, 3.2, 0.75), [15, 40])


def test_a_closed_chain_is_cut_wherever_its_first_node_is():
    valley = np.minimum(np.abs(np.arange(50) - 3), 50 - np.abs(np.arange(50) - 3)) * 0.3 + 1.0
    for shift in range(50):
        cuts = topology.crossing_nodes(np.roll(valley, shift), 3.2, 0.75, closed=True)
        np.testing.assert_array_equal(cuts, [(3 + shift) % 50])


def test_a_ring_stays_a_ring():
    angle = np.linspace(0, 2 * np.pi, 60, endpoint=False)
    ring = 0.04 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    parts = topology.split([ring], RADIUS, Splitting())
    assert parts.rings == (0,)
    joined = topology.reconnect(parts, RADIUS, None, Reconnection())
    ((nodes, closed),) = strings.assemble(parts.segments, joined, ring, RADIUS, Reconnection())
    assert closed
    assert len(nodes) >= 60


def test_two_ends_that_face_each_other_over_a_gap_are_joined_only_if_the_number_of_ropes_says_so():
    pieces = [straight((0, 0, 0), (0.1, 0, 0)), straight((0.13, 0, 0), (0.2, 0, 0))]
    parts = topology.split(pieces, RADIUS, Splitting())
    assert topology.reconnect(parts, RADIUS, None, Reconnection()).joins == ()
    assert topology.reconnect(parts, RADIUS, 2, Reconnection()).joins == ()
    assert topology.reconnect(parts, RADIUS, 1, Reconnection()).joins == ((1, 2),)
    assert topology.reconnect(parts, RADIUS, 1, Reconnection(gap=5.0)).joins == ()


@settings(deadline=None, max_examples=100)
@given(st.integers(1, 8), st.integers(0, 10_000))
def test_walking_visits_every_segment_once_and_follows_the_joins(count, seed):
    rng = np.random.default_rng(seed)
    ends = rng.permutation(2 * count)
    pairs = [(int(a), int(b)) for a, b in ends[: 2 * int(rng.integers(0, count + 1))].reshape(-1, 2)]
    walks = topology.walk(count, pairs)
    assert sorted(end // 2 for entered, _ in walks for end in entered) == list(range(count))
    links = {frozenset(pair) for pair in pairs}
    used = set()
    for entered, closed in walks:
        for a, b in zip(entered, entered[1:] + entered[:1], strict=True):
            link = frozenset({a ^ 1, b})
            if b != entered[0] or closed:
                assert link in links
                used.add(link)
    assert used == links


def test_bends_are_moved_back_by_what_the_average_took():
    angle = np.linspace(0, 1.5 * np.pi, 60)
    bend = 0.03
    nodes = (bend - 4 / 9 * RADIUS**2 / bend) * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    moved = strings.straighten(nodes, RADIUS, 3 * RADIUS)
    off = np.linalg.norm(moved, axis=1)[5:-5] - bend
    assert np.abs(off).max() < 0.1 * 4 / 9 * RADIUS**2 / bend
    line = straight((0, 0, 0), (0.1, 0.02, 0))
    np.testing.assert_allclose(strings.straighten(line, RADIUS, 3 * RADIUS), line, atol=1e-12)


@pytest.mark.parametrize("missing", [0.0, 0.5, 1.3, 2.8])
def test_the_end_is_found_by_counting(missing):
    rng = np.random.default_rng(1)
    length = 0.1
    axis = np.stack([rng.uniform(0, length, 4000), *rng.normal(scale=2e-4, size=(2, 4000))], axis=1)
    nodes = straight((0, 0, 0), (length - missing * RADIUS, 0, 0))
    reached = strings.reach_end(nodes, axis, 4000 / length, RADIUS, 3 * RADIUS)
    assert reached[-1, 0] == pytest.approx(length, abs=0.1 * RADIUS)
    assert np.abs(reached[-1, 1:]).max() < 1e-9
