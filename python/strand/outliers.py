"""Outlier filter (section IV-A)."""

from __future__ import annotations

import numpy as np

from strand import _core
from strand.config import Filter
from strand.view import View

# searching radii are not widened beyond this, in string radii
_WIDEST = 4.0


def without_outliers(view: View, radius: float, config: Filter) -> View:
    """Drop the points with too few neighbours.

    Parameters
    ----------
    view : View
    radius : float
        The string's radius, metres.
    config : Filter

    Returns
    -------
    View
    """
    if not len(view.points):
        return view
    reach = config.radius * radius
    counts = _core.count_neighbors(view.points, reach)
    usual = float(np.median(counts))
    while usual < config.usual and reach < _WIDEST * radius:
        # on a surface counts grow with the square of the reach
        reach *= float(np.clip(np.sqrt(config.usual / max(usual, 1.0)), 1.02, 1.5))
        counts = _core.count_neighbors(view.points, reach)
        usual = float(np.median(counts))
    enough = max(config.min_fraction * usual, config.min_neighbors)
    return view.only(counts >= enough)
