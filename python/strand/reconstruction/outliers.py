"""Outlier filter (section IV-A of *Shape Modeling of A String And Recognition Using Distance Sensor*)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.config import Filter
from strand.views.view import View

# searching radii are not widened beyond this, in rope radii
_WIDEST = 4.0


def drop_outliers(views: Sequence[View], radius: float, config: Filter, widen: bool) -> list[View]:
    """Drop the points with too few neighbours in their own view.

    Parameters
    ----------
    views : sequence of View
    radius : float
        The rope's radius, metres.
    config : Filter
    widen : bool
        Whether the searching radius is widened in views that are coarse for the rope.

    Returns
    -------
    list of View
    """
    reach = config.radius * radius
    counts = _core.count_neighbors_each([view.points for view in views], reach)
    kept = [
        _enough(view, own, reach, radius, config, widen) if len(own) else None
        for view, own in zip(views, counts, strict=True)
    ]
    return [view if some is None else view.only(some) for view, some in zip(views, kept, strict=True)]


def _enough(
    view: View, counts: NDArray[np.int64], reach: float, radius: float, config: Filter, widen: bool
) -> NDArray[np.bool_]:
    """Tell which points have enough neighbours, from how many they have within a reach."""
    median = _median(counts)
    while widen and median < config.widen_below and reach < _WIDEST * radius:
        # on a surface counts grow with the square of the reach
        reach *= float(np.clip(np.sqrt(config.widen_below / max(median, 1.0)), 1.02, 1.5))
        counts = _core.count_neighbors(view.points, reach)
        median = _median(counts)
    return counts >= max(config.min_fraction * median, config.min_neighbors)


def _median(counts: NDArray[np.int64]) -> float:
    """Return the middle of some numbers; NumPy's own also looks for NaN, for more than the filter takes."""
    half = len(counts) // 2
    parted = np.partition(counts, (half - 1, half) if len(counts) > 1 else half)
    return float(parted[half] if len(counts) % 2 else 0.5 * (parted[half - 1] + parted[half]))
