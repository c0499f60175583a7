"""Lengths and products of many vectors.

They have the bits of NumPy's sums over rows of less than eight numbers, which take longer for many rows.
"""

from __future__ import annotations

import numpy as np

from strand.support.checks import Array


def measure_lengths(vectors: Array) -> Array:
    """Return the lengths (N,) of vectors (N, K)."""
    return np.asarray(np.sqrt(multiply_rows(vectors, vectors)))


def multiply_rows(some: Array, others: Array) -> Array:
    """Return the inner products (N,) of vectors (N, K) with others."""
    (first, *more), (other, *more_others) = some.T, others.T
    products = np.asarray(first * other)
    for one, another in zip(more, more_others, strict=True):
        products += one * another
    return products
