"""Points that lie all around the camera that is said to have seen them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.doubt import Doubt
from strand.view import View

# points of a view that are looked at, and fewest
_POINTS, _FEWEST = 1000, 100
# no depth camera sees farther than this from the middle of what it sees, radians, however many points lie on
# one side; the share of points that may be off
_WIDEST, _OFF = np.radians(100.0), 0.05
# how much doubt that is
_AROUND = 5.0


def seen_all_around(views: Sequence[View]) -> Doubt | None:
    """Doubt viewpoints around which points lie farther than a camera sees.

    Parameters
    ----------
    views : sequence of View
        Those of depth images have their pinhole, and are not looked at.

    Returns
    -------
    Doubt or None
    """
    for number, view in enumerate(views):
        if view.image is not None or len(view.points) < _FEWEST:
            continue
        points = view.points[:: max(len(view.points) // _POINTS, 1)]
        towards = points / np.linalg.norm(points, axis=1)[:, None]
        middle = towards.mean(axis=0)
        middle /= max(float(np.linalg.norm(middle)), np.finfo(float).tiny)
        angles = np.arccos(np.clip(towards @ middle, -1.0, 1.0))
        if np.mean(angles > _WIDEST) > _OFF:
            reason = (
                "points look like world-frame ones: use View.from_world, with the camera's place; those of "
                f"view {number} lie all around their camera, up to "
                f"{np.degrees(np.quantile(angles, 1.0 - _OFF)):.0f} degrees from where most are"
            )
            return Doubt("viewpoint", _AROUND, "where the ropes are", reason)
    return None
