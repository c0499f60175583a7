"""Which messages of several cameras were taken at the same time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]


def match_messages(times: Sequence[Times], tolerance: int) -> NDArray[np.int64]:
    """(F, T) Numbers of the messages of T topics that belong together, one row for each frame.

    Each message of the first topic makes a frame with the message of every other topic that is nearest in
    time, of two as near the earlier; without one within the tolerance it makes none. Messages may be used
    twice.

    Parameters
    ----------
    times : sequence of (N,) ndarray
        Time stamps of each topic's messages, nanoseconds, in any order.
    tolerance : int
        How far apart two may be, nanoseconds.
    """
    first = times[0]
    rows = [np.arange(len(first))]
    near = np.ones(len(first), dtype=bool)
    for other in times[1:]:
        if not len(other):
            return np.empty((0, len(times)), dtype=np.int64)
        order = np.argsort(other, kind="stable")
        ordered = other[order]
        after = np.searchsorted(ordered, first).clip(1, max(len(other) - 1, 1))
        before = after - 1
        after = np.minimum(after, len(other) - 1)
        nearest = np.where(np.abs(ordered[after] - first) < np.abs(first - ordered[before]), after, before)
        near &= np.abs(ordered[nearest] - first) <= tolerance
        rows.append(order[nearest])
    return np.stack(rows, axis=1)[near]
