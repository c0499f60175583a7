"""Match the messages of several cameras by their times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Times = NDArray[np.int64]


def match_messages(times: Sequence[Times], tolerance: int) -> NDArray[np.int64]:
    """Return (F, T) message numbers: one row for each frame, one column for each of T topics.

    Each message of the first topic makes a frame with the nearest message in time of every other topic;
    with two equally near, the earlier. If one is farther away than the tolerance, there is no frame. A
    message may be in several frames.

    Parameters
    ----------
    times : sequence of (N,) ndarray
        Time stamps of each topic's messages, nanoseconds, in any order.
    tolerance : int
        Nanoseconds.
    """
    first = times[0]
    rows = [np.arange(len(first))]
    near = np.ones(len(first), dtype=bool)
    for other in times[1:]:
        nearest = find_nearest(first, other, tolerance)
        near &= nearest >= 0
        rows.append(nearest)
    return np.stack(rows, axis=1)[near]


def find_nearest(first: Times, other: Times, tolerance: int) -> NDArray[np.int64]:
    """(N,) Return the number of the nearest other time to each time; -1 where none is near enough."""
    if not len(other):
        return np.full(len(first), -1, dtype=np.int64)
    order = np.argsort(other, kind="stable")
    ordered = other[order]
    after = np.searchsorted(ordered, first).clip(1, max(len(other) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(other) - 1)
    nearest = np.where(np.abs(ordered[after] - first) < np.abs(first - ordered[before]), after, before)
    return np.where(np.abs(ordered[nearest] - first) <= tolerance, order[nearest], -1)


def find_last_uses(
    parts: NDArray[np.int64], streams: Sequence[int], numbers: range
) -> dict[int, NDArray[np.int64]]:
    """Return for each stream the last frame that needs each of its messages; -1 where none does.

    Parameters
    ----------
    parts : (F, P) ndarray
        Message numbers of the parts of each frame; -1 is no message.
    streams : sequence of int
        The stream of each part.
    numbers : range
        The frames that are read.
    """
    frames = np.arange(len(parts))[numbers.start : numbers.stop : numbers.step]
    found = {k: np.full(parts.max(initial=-1) + 1, -1) for k in streams}
    for part, k in zip(parts.T, streams, strict=True):
        rows = frames[part[frames] >= 0]
        np.maximum.at(found[k], part[rows], rows)
    return found
