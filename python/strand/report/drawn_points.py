"""Choose the points that pictures of ropes show."""

from __future__ import annotations

import numpy as np

from strand.report.drawing import pick_spread
from strand.ropes.model import Model
from strand.support.checks import Array

_NEAR = 3.0  # radii: points nearer to a rope's axis are drawn densely
_FAR_SHARE = 0.25  # of the points that are drawn may lie farther away
_TRIED = 10  # times as many points are looked at as are drawn


def choose_points(points: Array, model: Model, most: int) -> Array:
    """Return at most so many of points (N, 3); where that is not all, few of those far from ropes."""
    if len(points) <= most or not model.chains:
        return np.asarray(points[pick_spread(len(points), most)])
    points = points[pick_spread(len(points), _TRIED * most)]
    reach = _NEAR * max(chain.radius for chain in model.chains)
    near = model.nearest(points).distance < reach
    close, others = points[near], points[~near]
    thin = others[pick_spread(len(others), int(_FAR_SHARE * most))]
    return np.concatenate([close[pick_spread(len(close), most - len(thin))], thin])
