"""Pairs of boxes that meet, found by a grid."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

Pairs = NDArray[np.intp]


def find_meeting_boxes(low: NDArray[Any], high: NDArray[Any], cell: float) -> Iterator[tuple[Pairs, Pairs]]:
    """Yield the pairs of boxes that meet or touch, each pair once, in batches.

    Boxes have the corners `low` and `high`, (N, D). They should not be much wider than a `cell` of the grid.
    """
    dimensions = low.shape[1]
    first, last = ((corner // cell).astype(np.int64) for corner in (low, high))
    wide = last - first + 1
    count = wide.prod(axis=1)
    holder = np.repeat(np.arange(len(low)), count)
    # all cells of each box, box by box
    at = np.arange(len(holder)) - np.repeat(np.cumsum(count) - count, count)
    corner = first[holder]
    for k in range(dimensions):
        corner[:, k] += at % wide[holder, k]
        at //= wide[holder, k]
    # distant cells may share a key; their boxes do not meet
    key = _hash_cells(corner)
    order = np.argsort(key, kind="stable")
    key, holder = key[order], holder[order]
    here = np.arange(len(key))
    for ahead in range(1, len(key)):
        here = here[: np.searchsorted(here, len(key) - ahead)]
        here = here[key[here] == key[here + ahead]]
        if not len(here):
            return
        i, j = holder[here], holder[here + ahead]
        # count a pair only in the cell where the overlap begins
        start = np.maximum(low[i], low[j])
        mine = (start <= np.minimum(high[i], high[j])).all(axis=1)
        mine &= _hash_cells((start // cell).astype(np.int64)) == key[here]
        yield i[mine], j[mine]


def _hash_cells(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return one number (N,) for each cell."""
    key = cells[:, 0].copy()
    for k in range(1, cells.shape[1]):
        key = (key << (62 // cells.shape[1])) + cells[:, k]
    return key
