"""Depths that are too far for ropes to be seen there: likely in millimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.ropes.doubt import Doubt
from strand.views.view import View

# every so many depths are looked at
_EVERY = 97
# at this many radii a rope is a fraction of a pixel wide, of any camera; how much doubt that is
_FARTHEST, _TOO_FAR = 10_000.0, 5.0


def too_far(views: Sequence[View], radius: float) -> Doubt | None:
    """Doubt depths at which no rope would be seen.

    Parameters
    ----------
    views : sequence of View
    radius : float
        The ropes' radius, metres.

    Returns
    -------
    Doubt or None
    """
    # of points of a world only the distance from the camera is known
    depths = [
        np.linalg.norm(view.points[::_EVERY], axis=1)
        if view.image is None
        else view.image.depth.ravel()[::_EVERY]
        for view in views
    ]
    some = np.concatenate(depths)
    some = some[some > 0]
    if not len(some) or not np.median(some) > _FARTHEST * radius:
        return None
    cameras = [float(np.linalg.norm(view.viewpoint)) for view in views if view.image is None]
    # where points are of the world the cameras are as far away
    looks = "depths look like millimetres: give depth_scale=0.001, or points * 0.001"
    if len(cameras) == len(views) and min(cameras) > _FARTHEST * radius:
        looks = "points and poses look like millimetres: give both in metres"
    reason = f"{looks}; half of them are more than {np.median(some):.0f} m away"
    return Doubt("depth", _TOO_FAR, "where the ropes are", reason)
