"""Labels of masks as evidence: a rope that goes from one label to another is a little less likely."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

_MIN_RUN = 8  # nodes of one label in a row that count: where ropes cross, both show the upper one's label


def count_label_changes(labels: NDArray[np.int32] | NDArray[np.bool_], chains: Sequence[Array]) -> int:
    """Return how often ropes go from one label to another.

    Parameters
    ----------
    labels : (H, W) ndarray of int
        0 is no rope.
    chains : sequence of (M, 2) ndarray
        Columns and rows of each rope's nodes, pixels.
    """
    height, width = labels.shape
    changes = 0
    for nodes in chains:
        columns, rows = np.rint(nodes).astype(np.int64).T
        inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        along = labels[rows[inside], columns[inside]]
        along = along[along != 0]
        starts = np.flatnonzero(np.diff(along, prepend=along[:1] - 1))
        lengths = np.diff(starts, append=len(along))
        kept = along[starts[lengths >= _MIN_RUN]]
        changes += int(np.count_nonzero(np.diff(kept)))
    return changes
