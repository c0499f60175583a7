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
    counts = _core.count_neighbors(view.points, config.radius * radius)
    enough = max(config.min_fraction * float(np.median(counts)), config.min_neighbors)
    return replace(view, points=view.points[counts >= enough])
