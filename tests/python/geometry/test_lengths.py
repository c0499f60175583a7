"""Lengths and products of many vectors."""

from __future__ import annotations

import numpy as np
import pytest

from strand.geometry.lengths import measure_lengths, multiply_rows


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_lengths_and_products_have_the_bits_of_sums_over_rows(size: int):
    some, others = np.random.default_rng(size).normal(size=(2, 100, size))
    np.testing.assert_array_equal(measure_lengths(some), np.linalg.norm(some, axis=1))
    np.testing.assert_array_equal(multiply_rows(some, others), (some * others).sum(axis=1))
    assert not len(measure_lengths(some[:0]))
