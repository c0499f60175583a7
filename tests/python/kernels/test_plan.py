"""Crossings of lines in a plan, against brute force over all pairs in whole numbers."""

from __future__ import annotations

import time
from fractions import Fraction

import numpy as np
import pytest

from strand._core import find_crossed_segments


def lines(*counts, closed=False):
    """Segments of lines of so many nodes each."""
    found, first = [], 0
    for count in counts:
        nodes = first + np.arange(count)
        ends = np.stack([nodes, np.roll(nodes, -1)], axis=1)
        found.append(ends if closed else ends[:-1])
        first += count
    return np.concatenate(found)


def side(a, b, c):
    (ax, ay), (bx, by), (cx, cy) = ([Fraction(float(x)) for x in place] for place in (a, b, c))
    return (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)


def brute_force(nodes, segments):
    found = []
    for i, one in enumerate(segments):
        for j, other in enumerate(segments[i + 1 :], i + 1):
            if set(one) & set(other):
                continue
            (a, b), (c, d) = nodes[one], nodes[other]
            if side(c, d, a) * side(c, d, b) < 0 and side(a, b, c) * side(a, b, d) < 0:
                found.append((i, j))
    return found


@pytest.mark.parametrize("seed", range(6))
def test_all_crossings_are_found_whatever_the_lines_are_like(seed):
    rng = np.random.default_rng(seed)
    nodes = rng.normal(size=(70, 2))
    if seed % 2:
        nodes = np.cumsum(nodes, axis=0)
    if seed == 4:
        nodes[::9] *= 1e3  # few long segments among short ones
    segments = lines(40, 30)
    pairs, shares, turns = find_crossed_segments(nodes, segments)
    assert [tuple(pair) for pair in pairs.tolist()] == brute_force(nodes, segments)
    assert len(pairs) > 5
    start, step = nodes[segments[:, 0]], nodes[segments[:, 1]] - nodes[segments[:, 0]]
    here, there = (start[pairs[:, k]] + shares[:, k, None] * step[pairs[:, k]] for k in (0, 1))
    np.testing.assert_allclose(here, there, atol=1e-6 * np.ptp(nodes))
    a, b = step[pairs[:, 0]], step[pairs[:, 1]]
    np.testing.assert_array_equal(turns, np.sign(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


@pytest.mark.parametrize("seed", range(40))
def test_closed_lines_on_a_coarse_lattice_cross_evenly(seed):
    # nodes on nodes, nodes on segments and segments on segments everywhere
    nodes = np.random.default_rng(seed).integers(0, 4, (24, 2)).astype(float)
    pairs, _, turns = find_crossed_segments(nodes, lines(12, 12, closed=True))
    both = (pairs[:, 0] < 12) & (pairs[:, 1] >= 12)
    assert both.sum() % 2 == 0
    assert turns[both].sum() == 0


def test_a_line_through_a_node_crosses_once_and_one_that_touches_it_evenly():
    bent = [[-1.0, 0.0], [0.0, 0.0], [1.0, 1.0]]
    for other, count in (([[0.0, -1.0], [0.0, 1.0]], 1), ([[-1.0, -1.0], [0.0, 0.0], [0.0, -1.0]], 0)):
        pairs, _, turns = find_crossed_segments(np.array(bent + other), lines(3, len(other)))
        assert len(pairs) % 2 == count
        assert abs(turns.sum()) == count


@pytest.mark.parametrize("angle", [0.0, 0.35, np.pi / 4, -np.pi / 4])
def test_long_slanted_strokes_side_by_side_take_little_time(angle):
    count = 40_000
    strokes = np.column_stack([np.arange(count) % 2.0, np.linspace(0.0, 1.0, count)])
    turned = strokes @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    across = np.array([[0.5, -0.1], [0.5, 1.1]]) @ [
        [np.cos(angle), np.sin(angle)],
        [-np.sin(angle), np.cos(angle)],
    ]
    begun = time.process_time()
    pairs, _, _ = find_crossed_segments(np.concatenate([turned, across]), lines(count, 2))
    assert time.process_time() - begun < 3.0
    assert pairs.tolist() == [[k, count - 1] for k in range(count - 1)]


def test_the_search_stops_after_as_many_pairs_as_asked_for():
    nodes = np.random.default_rng(0).normal(size=(60, 2))
    found, _, _ = find_crossed_segments(nodes, lines(60))
    for most in (0, 1, len(found) - 1, len(found), len(found) + 1):
        pairs, shares, turns = find_crossed_segments(nodes, lines(60), most)
        assert len(pairs) == len(shares) == len(turns) == min(most, len(found))
        assert {tuple(pair) for pair in pairs.tolist()} <= {tuple(pair) for pair in found.tolist()}


def test_nothing_crosses_in_a_plan_without_extent():
    for nodes in (np.empty((0, 2)), np.zeros((4, 2))):
        pairs, shares, turns = find_crossed_segments(nodes, lines(len(nodes)))
        assert (pairs.shape, shares.shape, turns.shape) == ((0, 2), (0, 2), (0,))


def test_what_is_no_plan_is_refused():
    nodes, segments = np.random.default_rng(0).normal(size=(5, 2)), lines(5)
    for wrong in (segments - 1, segments + 1):
        with pytest.raises(ValueError, match="segments: expected numbers of 5 nodes"):
            find_crossed_segments(nodes, wrong)
    for wrong in (nodes[:, :1].copy(), np.full((5, 2), np.nan)):
        with pytest.raises(ValueError, match="nodes: expected"):
            find_crossed_segments(wrong, segments)
