"""The measure of a reconstruction, on chains with known faults."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from lib.measure import (
    Crossings,
    compute_frechet,
    compute_rms_in_order,
    find_crossings,
    measure_chains,
    resampled,
)

R = 0.004
ACROSS = np.array([0.0, 1.0, 0.0])


@pytest.fixture
def rope():
    """Return a loop: 0.05 m in, a circle of 0.03 m radius, 0.05 m on; its end passes over its start."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    into = np.stack([np.linspace(-0.05, 0.0, 50), np.zeros(50), np.full(50, R)], axis=1)
    circle = 0.03 * np.stack([np.sin(angle), 1.0 - np.cos(angle), np.zeros(200)], axis=1)
    circle[:, 2] = np.linspace(R, 3.0 * R, 200)
    on = into + np.array([0.05, 0.0, 2.0 * R])
    # turned a little, so that the strands cross instead of meeting in a line
    on[:, 1] -= 0.3 * on[:, 0]
    into[:, 1] -= 0.3 * into[:, 0]
    return np.vstack([into[:-1], circle, on[1:]])


def test_the_rope_itself_is_right_in_both_directions(rope):
    for chain in (rope, rope[::-1]):
        found = measure_chains([chain], [rope], R)
        assert found.right
        assert (found.chains, found.ropes) == (1, 1)
        # turned round, nodes are as far apart but elsewhere by parts of a step
        assert found.frechet * R < 1e-3
        assert found.rms < 1e-5
        assert found.length_error < 1e-9
        assert found.crossings == Crossings(1, 1, 1)


def test_a_shift_is_measured():
    nodes = np.linspace([0.0, 0.0, 0.0], [0.2, 0.0, 0.0], 50)
    found = measure_chains([nodes + 0.003 * ACROSS], [nodes], R)
    assert found.right
    assert found.frechet == pytest.approx(0.003 / R)
    assert found.rms == pytest.approx(0.003)
    assert not measure_chains([nodes + 1.51 * R * ACROSS], [nodes], R).right


def test_a_missing_end_counts_from_one_and_a_half_radii_on():
    nodes = np.linspace([0.0, 0.0, 0.0], [0.2, 0.0, 0.0], 2001)
    for missing, right in ((1.0, True), (2.0, False)):
        chain = nodes[nodes[:, 0] <= 0.2 - missing * R]
        found = measure_chains([chain], [nodes], R)
        assert found.right == right
        assert found.frechet == pytest.approx(missing, abs=0.1)
        assert found.length_error == pytest.approx(missing * R / 0.2, rel=0.02)


def test_a_shortcut_is_wrong_though_every_node_is_on_the_rope(rope):
    # from the crossing straight on, without the circle
    short = np.vstack([rope[:49], rope[248:]])
    found = measure_chains([short], [rope], R)
    assert not found.right
    assert found.rms < 1.5 * R
    assert found.frechet > 10.0
    assert found.crossings == Crossings(0, 1, 0)


def test_a_rope_in_two_parts_is_wrong(rope):
    found = measure_chains([rope[:150], rope[149:]], [rope], R)
    assert (found.chains, found.ropes, found.right) == (2, 1, False)
    # the better part is measured all the same
    assert np.isfinite([found.frechet, found.rms, found.length_error]).all()


def test_a_rope_without_a_chain_is_wrong():
    one = np.linspace([0.0, 0.0, 0.0], [0.2, 0.0, 0.0], 50)
    two = one + 0.05 * ACROSS
    assert measure_chains([two, one], [one, two], R).right
    found = measure_chains([one], [one, two], R)
    assert (found.chains, found.ropes, found.right) == (1, 2, False)
    assert found.frechet == np.inf
    assert found.rms < 1e-9
    for chains in ([], [one[:1]]):
        found = measure_chains(chains, [one], R)
        assert (found.chains, found.right) == (0, False)
        assert found.frechet == found.rms == found.length_error == np.inf


def test_ropes_that_change_places_where_they_cross_are_wrong():
    t = np.linspace(-0.1, 0.1, 201)[:, None]
    one, two = t * [1.0, 0.5, 0.0], t * [1.0, -0.5, 0.0]
    assert measure_chains([one, two], [one, two], R).right
    swapped = [np.vstack([one[:100], two[100:]]), np.vstack([two[:100], one[100:]])]
    assert not measure_chains(swapped, [one, two], R).right


def test_the_wrong_strand_on_top_is_no_crossing_found(rope):
    flipped = rope * [1.0, 1.0, -1.0] + [0.0, 0.0, 4.0 * R]
    assert measure_chains([flipped], [rope], 10.0 * R).crossings == Crossings(found=1, true=1, right=0)


def test_a_crossing_elsewhere_is_not_the_true_one(rope):
    chain = rope * [2.0, 2.0, 1.0]
    assert measure_chains([chain], [rope], R).crossings == Crossings(found=1, true=1, right=0)


def test_crossings_have_arc_lengths_and_heights(rope):
    ((low, high, rise),) = find_crossings(resampled(rope))
    lengths = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(rope, axis=0), axis=1))]
    at = [[np.interp(s, lengths, rope[:, k]) for k in range(3)] for s in (low, high)]
    np.testing.assert_allclose(at[0][:2], at[1][:2], atol=1e-4)
    assert rise == pytest.approx(at[1][2] - at[0][2], abs=1e-5)
    assert rise > R
    straight = np.linspace([0.1, 0.2, 0.0], [0.3, -0.1, 0.0], 300)
    assert len(find_crossings(straight)) == 0


def test_frechet_is_that_of_its_definition():
    rng = np.random.default_rng(0)
    for n, m in ((1, 1), (1, 5), (6, 1), (7, 9), (12, 5)):
        a, b = rng.normal(size=(n, 3)), rng.normal(size=(m, 3))

        @cache
        def leash(i, j, a=a, b=b):
            before = [(k, p) for k, p in ((i - 1, j), (i, j - 1), (i - 1, j - 1)) if k >= 0 and p >= 0]
            shortest = min((leash(*pair) for pair in before), default=0.0)
            return max(float(np.linalg.norm(a[i] - b[j])), shortest)

        assert compute_frechet(a, b) == pytest.approx(leash(n - 1, m - 1), rel=1e-12)


def test_errors_are_counted_in_order_along_the_rope():
    # two strands side by side, 0.01 m apart, joined at one end
    there = np.linspace([0.0, 0.0, 0.0], [0.1, 0.0, 0.0], 101)
    back = there[::-1] + 0.01 * ACROSS
    rope = np.vstack([there, back])
    assert compute_rms_in_order(rope, rope) == 0.0
    # one that starts on the wrong strand gets no credit for lying on it
    wrong = np.vstack([there + 0.01 * ACROSS, back])
    assert compute_rms_in_order(wrong, rope) > 0.006


def test_resampling_keeps_ends_and_length(rope):
    nodes = resampled(rope)
    np.testing.assert_allclose(nodes[[0, -1]], rope[[0, -1]])
    steps = [np.linalg.norm(b - a) for a, b in pairwise(nodes)]
    assert max(steps) < 1.01e-3
    assert sum(steps) == pytest.approx(np.linalg.norm(np.diff(rope, axis=0), axis=1).sum(), rel=1e-3)
