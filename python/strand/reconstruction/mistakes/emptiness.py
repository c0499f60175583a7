"""Why nothing lies in the extraction range: the likely mistake is the one without which points would."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.reconstruction.masks import explain_empty_mask
from strand.reconstruction.mistakes.undo import IN_MILLIMETERS, MISTAKES
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.box import Box, metres
from strand.views.pose import moved
from strand.views.view import View

_SAMPLE = 20_000  # points of each view that are looked at
_MIN_SHARE = 1e-3  # of these points lie in the range once the likely mistake is undone
_BOUNDS_IN_MILLIMETERS = "bounds look like millimetres: give them in metres"
_OTHER_MASKS = "points outside of the masks do lie there: are the masks those of these frames?"


def explain_emptiness(views: Sequence[View], bounds: Box | None, mistakes: Sequence[Doubt]) -> str:
    """Say where the points and the extraction range are, and which mistake would explain that.

    Parameters
    ----------
    views : sequence of View
        None of them has a point in the range.
    bounds : Box or None
        The extraction range, metres.
    mistakes : sequence of Doubt
        Mistakes that the views alone show, the likeliest first.
    """
    clouds = [view.points[:: max(len(view.points) // _SAMPLE, 1)] for view in views]
    masked = [f"view {i} has {why}" for i, view in enumerate(views) if (why := explain_empty_mask(view))]
    if masked and not any(map(len, clouds)):
        return f"no view has a point: {', '.join(masked)}; 0 in a mask is no rope, every other number is rope"
    if bounds is None or not any(map(len, clouds)):
        return "no view has a point; are all depths 0 or not finite?"
    placed = np.concatenate([view.world_points for view in views])
    likely = mistakes[0].reason if mistakes else _find_likely_mistake(views, clouds, bounds)
    return (
        "no view has a point in the extraction range: "
        f"the points lie between {metres(placed.min(axis=0))} and {metres(placed.max(axis=0))} m, "
        f"the range is {bounds}; {likely}"
    )


def _find_likely_mistake(views: Sequence[View], clouds: Sequence[Array], bounds: Box) -> str:
    """Name the mistake without which most points lie in bounds."""
    inside = {
        mistake.advice: _count_inside(
            [_sample_points(view) for view in mistake.undo(views) if view is not None], bounds
        )
        for mistake in (*MISTAKES, IN_MILLIMETERS)
    }
    inside[_BOUNDS_IN_MILLIMETERS] = _count_inside(
        [1e3 * moved(c, v.pose) for c, v in zip(clouds, views, strict=True)], bounds
    )
    inside[_OTHER_MASKS] = _count_inside(
        [_sample_outside_mask(c, v) for c, v in zip(clouds, views, strict=True)], bounds
    )
    likely = max(inside, key=inside.__getitem__)
    if inside[likely] > _MIN_SHARE * sum(map(len, clouds)):
        return likely
    return "are bounds, poses and units those of one world frame, in metres?"


def _count_inside(clouds: Sequence[Array], bounds: Box) -> int:
    return int(np.count_nonzero(bounds.holds(np.concatenate([np.empty((0, 3)), *clouds]))))


def _sample_points(view: View) -> Array:
    """Return some of a view's points, world frame, metres."""
    return moved(view.points[:: max(len(view.points) // _SAMPLE, 1)], view.pose)


def _sample_outside_mask(cloud: Array, view: View) -> Array:
    """Return as many points of a whole masked image as its cloud has, world frame, metres."""
    image = view.image
    if image is None or image.labels is None or not len(cloud):
        return np.empty((0, 3))
    points = _core.unproject(image.depth, *image.camera)
    return moved(points[:: max(len(points) // len(cloud), 1)], view.pose)
