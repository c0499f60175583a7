"""Outlier filter (section IV-A of *Shape Modeling of A String And Recognition Using Distance Sensor*)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.config import Filter
from strand.views.view import View

_MAX_REACH = 4.0  # radii: searching radii are not widened beyond this
_MIN_STEP = 1.02  # factor by which a searching radius is widened
_MAX_STEP = 1.5  # factor by which a searching radius is widened


def drop_outliers(views: Sequence[View], radius: float, config: Filter, widen: bool) -> list[View]:
    """Return views without the points that have too few neighbours in their own view.

    Parameters
    ----------
    views : sequence of View
    radius : float
        The rope's radius, metres.
    config : Filter
    widen : bool
        Whether to widen the searching radius in views that are coarse for the rope.
    """
    reach = config.radius * radius
    counts = _core.count_neighbors_each([view.points for view in views], reach)
    kept = [
        _have_neighbors(view, own, reach, radius, config, widen) if len(own) else None
        for view, own in zip(views, counts, strict=True)
    ]
    return [view if some is None else view.select(some) for view, some in zip(views, kept, strict=True)]


def _have_neighbors(
    view: View, counts: NDArray[np.int64], reach: float, radius: float, config: Filter, widen: bool
) -> NDArray[np.bool_]:
    """Tell which points have enough neighbours, given how many they have within a reach."""
    median = _find_median(counts)
    while widen and median < config.widen_below and reach < _MAX_REACH * radius:
        # on a surface counts grow with the square of the reach
        reach *= float(np.clip(np.sqrt(config.widen_below / max(median, 1.0)), _MIN_STEP, _MAX_STEP))
        counts = _core.count_neighbors(view.points, reach)
        median = _find_median(counts)
    return counts >= max(config.min_fraction * median, config.min_neighbors)


def _find_median(counts: NDArray[np.int64]) -> float:
    """Return the median; NumPy's own takes longer than the filter, as it also looks for NaN."""
    half = len(counts) // 2
    parted = np.partition(counts, (half - 1, half) if len(counts) > 1 else half)
    return float(parted[half] if len(counts) % 2 else 0.5 * (parted[half - 1] + parted[half]))
