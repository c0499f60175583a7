"""Cutting chains at crossings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strand.geometry.polyline import path_length
from strand.reconstruction.published.splitting import find_crossing_nodes, measure_separation

RADIUS = 0.004


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10_000), st.integers(1, 3), st.booleans())
def test_separation_is_the_least_distance_outside_the_neighbourhood(seed, count, closed):
    rng = np.random.default_rng(seed)
    chains = [np.cumsum(rng.normal(size=(rng.integers(2, 30), 3)), axis=0) for _ in range(count)]
    found = measure_separation(chains, 3.0, [closed] * count)
    for i, chain in enumerate(chains):
        s = path_length(chain)
        around = s[-1] + np.linalg.norm(chain[0] - chain[-1])
        for a in range(len(chain)):
            least = np.inf
            for j, other in enumerate(chains):
                for b in range(len(other)):
                    distance = abs(s[a] - s[b]) if i == j else np.inf
                    if i == j and closed:
                        distance = min(distance, around - distance)
                    if distance > 3.0:
                        least = min(least, np.linalg.norm(chain[a] - other[b]))
            assert found[i][a] == pytest.approx(least)


def test_neither_noise_nor_an_end_near_another_strand_is_cut():
    noise = np.random.default_rng(0).normal(scale=0.05, size=200)
    assert len(find_crossing_nodes(2.5 + noise, 3.2, 0.75)) == 0
    falling_to_an_end = np.linspace(6, 1, 30)
    assert len(find_crossing_nodes(falling_to_an_end, 3.2, 0.75)) == 0
    valley = np.abs(np.arange(-20, 21)) * 0.3 + 1.0
    np.testing.assert_array_equal(find_crossing_nodes(valley, 3.2, 0.75), [20])
    two = np.minimum(np.abs(np.arange(60) - 15), np.abs(np.arange(60) - 40)) * 0.2 + 1.0
    np.testing.assert_array_equal(find_crossing_nodes(two, 3.2, 0.75), [15, 40])


def test_a_closed_chain_is_cut_wherever_its_first_node_is():
    valley = np.minimum(np.abs(np.arange(50) - 3), 50 - np.abs(np.arange(50) - 3)) * 0.3 + 1.0
    for shift in range(50):
        cuts = find_crossing_nodes(np.roll(valley, shift), 3.2, 0.75, closed=True)
        np.testing.assert_array_equal(cuts, [(3 + shift) % 50])
