"""Outlier filter (section IV-A)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand import _core
from strand.config import Filter
from strand.view import View

# searching radii are not widened beyond this, in string radii
_WIDEST = 4.0


def without_outliers(views: Sequence[View], radius: float, config: Filter) -> list[View]:
    """Drop the points with too few neighbours in their own view.

    Parameters
    ----------
    views : sequence of View
    radius : float
        The string's radius, metres.
    config : Filter

    Returns
    -------
    list of View
    """
    reach = config.radius * radius
    counts = _core.count_neighbors_each([view.points for view in views], reach)
    return [
        view.only(_enough(view, own, reach, radius, config)) if len(own) else view
        for view, own in zip(views, counts, strict=True)
    ]


def _enough(
    view: View, counts: NDArray[np.int64], reach: float, radius: float, config: Filter
) -> NDArray[np.bool_]:
    """Tell which points have enough neighbours, from how many they have within a reach."""
    usual = _median(counts)
    while usual < config.usual and reach < _WIDEST * radius:
        # on a surface counts grow with the square of the reach
        reach *= float(np.clip(np.sqrt(config.usual / max(usual, 1.0)), 1.02, 1.5))
        counts = _core.count_neighbors(view.points, reach)
        usual = _median(counts)
    return counts >= max(config.min_fraction * usual, config.min_neighbors)


def _median(counts: NDArray[np.int64]) -> float:
    """Return the middle of some numbers; NumPy's own also looks for NaN, for more than the filter takes."""
    half = len(counts) // 2
    parted = np.partition(counts, (half - 1, half) if len(counts) > 1 else half)
    return float(parted[half] if len(counts) % 2 else 0.5 * (parted[half - 1] + parted[half]))
