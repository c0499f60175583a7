"""Points that the camera that is said to have seen them cannot have seen, for where they lie."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from strand.ropes.doubt import Doubt
from strand.views.view import View

# points of a view that are looked at, and fewest
_POINTS, _FEWEST = 1000, 100
# no depth camera sees farther than this from the middle of what it sees, radians, however many points lie on
# one side; the share of points that may be off
_WIDEST, _OFF = np.radians(100.0), 0.05
# how much doubt that is
_AROUND = 5.0
# cells of directions are so many to a unit vector's length; those that a view sees have so many of its
# points, of so many; views that see fewer than this show ropes alone
_CELLS, _SEEN, _LOOKED, _WHOLE = 16.0, 3, 20_000, 100
# a camera that stays sees this share of all that two views see in both; how much doubt it is if it does not
_SAME, _ELSEWHERE = 0.8, 1.5


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


def seen_from_one_place(views: Sequence[View]) -> Doubt | None:
    """Doubt views of points of a whole scene that share their pose, and look elsewhere.

    A camera that stays where it is sees the same directions in all views. World points without a viewpoint
    look as if one had turned.

    Parameters
    ----------
    views : sequence of View
        Those of depth images are not looked at.

    Returns
    -------
    Doubt or None
    """
    groups: dict[bytes, list[int]] = {}
    for number, view in enumerate(views):
        if view.image is None:
            groups.setdefault(view.pose.tobytes(), []).append(number)
    for group in groups.values():
        if len(group) < 2:
            continue
        seen = [cells for number in group if len(cells := _directions_seen(views[number])) >= _WHOLE]
        for one, other in itertools.pairwise(seen):
            both = len(one & other) / len(one | other)
            if both < _SAME:
                reason = (
                    "points look like world-frame ones: use View.from_world, with the camera's place; views "
                    f"{_listed(group)} are said to be from one place, and only {both:.0%} of the directions "
                    "in which two of them show something are common to both"
                )
                return Doubt("viewpoint", _ELSEWHERE, "where the ropes are", reason)
    return None


def _directions_seen(view: View) -> set[int]:
    """Cells of directions in which a view of points shows something."""
    points = view.points[:: max(len(view.points) // _LOOKED, 1)]
    away = np.linalg.norm(points, axis=1)
    towards = points[away > 0.0] / away[away > 0.0, None]
    cells = np.floor(_CELLS * (towards + 1.0)).astype(np.int64) @ (1, 1000, 1_000_000)
    found, counts = np.unique(cells, return_counts=True)
    return set(found[counts >= _SEEN].tolist())


def _listed(numbers: Sequence[int]) -> str:
    return f"{', '.join(map(str, numbers[:-1]))} and {numbers[-1]}"
