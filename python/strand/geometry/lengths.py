"""Lengths of many vectors."""

from __future__ import annotations

import numpy as np

from strand.support.checks import Array


def measure_lengths(vectors: Array) -> Array:
    """Return the lengths (N,) of vectors (N, K).

    They have the bits of `numpy.linalg.norm`, which takes several times as long for short rows.
    """
    first, *others = vectors.T
    squares = first * first
    for axis in others:
        squares += axis * axis
    return np.asarray(np.sqrt(squares))
