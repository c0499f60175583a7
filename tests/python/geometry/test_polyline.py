"""Ordered nodes."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strand.geometry.polyline import find_runs, interpolate, order_segments


@settings(deadline=None, max_examples=100)
@given(st.integers(1, 8), st.integers(0, 10_000))
def test_walking_visits_every_segment_once_and_follows_the_joins(count, seed):
    rng = np.random.default_rng(seed)
    ends = rng.permutation(2 * count)
    pairs = [(int(a), int(b)) for a, b in ends[: 2 * int(rng.integers(0, count + 1))].reshape(-1, 2)]
    walks = order_segments(count, pairs)
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


@given(st.lists(st.booleans(), max_size=30))
def test_runs_are_the_stretches_that_are_marked(marked):
    found = find_runs(np.array(marked, dtype=bool))
    again = np.zeros(len(marked), dtype=bool)
    for start, stop in found:
        assert 0 <= start < stop <= len(marked)
        again[start:stop] = True
    assert again.tolist() == marked
    # none can be longer
    assert all(stop < start for (_, stop), (start, _) in pairwise(found.tolist()))


def test_covariances_between_nodes_are_linear_and_at_nodes_their_own():
    rng = np.random.default_rng(4)
    roots = rng.normal(size=(5, 3, 3))
    values = roots @ roots.transpose(0, 2, 1)
    known = np.linspace(0.0, 1.0, 5)
    assert interpolate(known, known, values) == pytest.approx(values)
    assert interpolate(np.array([0.125]), known, values)[0] == pytest.approx(0.5 * (values[0] + values[1]))
    found = interpolate(rng.uniform(size=100), known, values)
    assert (np.linalg.eigvalsh(found) > 0).all()


@pytest.mark.parametrize("shape", [(), (3,), (3, 3)])
def test_values_between_places_have_the_bits_of_the_formula(shape):
    rng = np.random.default_rng(6)
    known, values = np.sort(rng.normal(size=9)), rng.normal(size=(9, *shape))
    places = np.append(rng.normal(scale=2.0, size=30), known).reshape(3, 13)
    k = np.clip(np.searchsorted(known, places, side="right") - 1, 0, 7)
    part = (places - known[k]) / (known[k + 1] - known[k])
    part = part.reshape(part.shape + (1,) * len(shape))
    assert np.array_equal(interpolate(places, known, values), (1.0 - part) * values[k] + part * values[k + 1])


def test_values_between_places_need_two_of_them_and_one_value_each():
    for known, values in ((np.zeros(1), np.zeros(1)), (np.arange(2.0), np.zeros(3)), (np.arange(2.0), 1.0)):
        with pytest.raises(ValueError, match=r"known|values"):
            interpolate(np.zeros(1), known, values)
