"""Boxes that meet: found by a grid, in time that grows with the boxes and the pairs in one cell."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pairs = NDArray[np.intp]


def find_meeting_boxes(low: NDArray[Any], high: NDArray[Any], cell: float) -> Iterator[tuple[Pairs, Pairs]]:
    """Yield all pairs of boxes that meet, each once, some of them at a time.

    Parameters
    ----------
    low, high : (N, D) ndarray
        Corners of the boxes; those that only touch meet.
    cell : float
        How wide a cell of the grid is. Boxes should not be much wider.
    """
    dimensions = low.shape[1]
    first, last = ((corner // cell).astype(np.int64) for corner in (low, high))
    wide = last - first + 1
    count = wide.prod(axis=1)
    holder = np.repeat(np.arange(len(low)), count)
    # all cells that each box lies in, one after the other
    at = np.arange(len(holder)) - np.repeat(np.cumsum(count) - count, count)
    corner = first[holder]
    for k in range(dimensions):
        corner[:, k] += at % wide[holder, k]
        at //= wide[holder, k]
    # cells far from each other may share a key: then their boxes do not meet
    key = _key(corner)
    order = np.argsort(key, kind="stable")
    key, holder = key[order], holder[order]
    here = np.arange(len(key))
    for ahead in range(1, len(key)):
        here = here[: np.searchsorted(here, len(key) - ahead)]
        here = here[key[here] == key[here + ahead]]
        if not len(here):
            return
        i, j = holder[here], holder[here + ahead]
        # only in the cell in which what they share begins
        start = np.maximum(low[i], low[j])
        mine = (start <= np.minimum(high[i], high[j])).all(axis=1)
        mine &= _key((start // cell).astype(np.int64)) == key[here]
        yield i[mine], j[mine]


def _key(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """(N,) One number for each cell."""
    key = cells[:, 0].copy()
    for k in range(1, cells.shape[1]):
        key = (key << (62 // cells.shape[1])) + cells[:, k]
    return key
