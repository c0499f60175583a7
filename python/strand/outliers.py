"""Outlier filter (section IV-A)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strand import _core
from strand.config import Filter
from strand.view import View


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
    if 0 < usual < config.usual:
        # on a surface counts grow with the square of the reach
        counts = _core.count_neighbors(view.points, reach * np.sqrt(config.usual / usual))
        usual = float(np.median(counts))
    enough = max(config.min_fraction * usual, config.min_neighbors)
    return replace(view, points=view.points[counts >= enough])
