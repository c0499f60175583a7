"""Why nothing lies in the extraction range: the likely mistake is the one without which points would."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.reconstruction.mistakes.diagnosis import suspected, thinnest
from strand.reconstruction.mistakes.undo import IN_MILLIMETRES, MISTAKES
from strand.reconstruction.radius import Radii
from strand.support.checks import Array
from strand.views.box import Box, metres
from strand.views.pose import moved
from strand.views.view import View

# so many points of each view are looked at; a cause is likely if it explains this share of them
_ENOUGH, _SHARE = 20_000, 1e-3
# mistakes that only bounds and masks can show
_BOUNDS = "bounds look like millimetres: give them in metres"
_MASKS = "points outside of the masks do lie there: are the masks those of these frames?"


def why_empty(views: Sequence[View], bounds: Box | None, radii: Radii | None) -> str:
    """Say where the points are, where the extraction range is, and what mistake would explain it.

    Parameters
    ----------
    views : sequence of View
        None of which has a point in the range.
    bounds : Box or None
        The extraction range, metres.
    radii : Radii or None
        If they were given.
    """
    clouds = [view.points[:: max(len(view.points) // _ENOUGH, 1)] for view in views]
    masked = [f"view {i} has {why}" for i, view in enumerate(views) if (why := mask_without_points(view))]
    if masked and not any(map(len, clouds)):
        return f"no view has a point: {', '.join(masked)}; 0 in a mask is no rope, every other number is rope"
    if bounds is None or not any(map(len, clouds)):
        return "no view has a point; are all depths 0 or not finite?"
    placed = np.concatenate([view.world_points for view in views])
    return (
        "no view has a point in the extraction range: "
        f"the points lie between {metres(placed.min(axis=0))} and {metres(placed.max(axis=0))} m, "
        f"the range is {bounds}; {_likely(views, clouds, bounds, radii)}"
    )


def _likely(views: Sequence[View], clouds: Sequence[Array], bounds: Box, radii: Radii | None) -> str:
    """Name the mistake that views show by themselves, or that without which most points lie in bounds."""
    doubts = suspected(views, views, bounds, thinnest(radii))
    if doubts:
        return doubts[0].reason
    inside = {
        mistake.suspected: _count_inside(
            [_some_points(view) for view in mistake.undone(views) if view is not None], bounds
        )
        for mistake in (*MISTAKES, IN_MILLIMETRES)
    }
    inside[_BOUNDS] = _count_inside(
        [1e3 * moved(c, v.pose) for c, v in zip(clouds, views, strict=True)], bounds
    )
    inside[_MASKS] = _count_inside([_outside_mask(c, v) for c, v in zip(clouds, views, strict=True)], bounds)
    likely = max(inside, key=inside.__getitem__)
    if inside[likely] > _SHARE * sum(map(len, clouds)):
        return likely
    return "are bounds, poses and units those of one world frame, in metres?"


def mask_without_points(view: View) -> str | None:
    """Say what is wrong with a mask in which no point lies; None if one does, or there is no mask."""
    mask = view.mask
    if mask is None or len(view.points):
        return None
    return "no depth inside its mask" if mask.any() else "an empty mask"


def _count_inside(clouds: Sequence[Array], bounds: Box) -> int:
    return int(np.count_nonzero(bounds.holds(np.concatenate([np.empty((0, 3)), *clouds]))))


def _some_points(view: View) -> Array:
    """Return some of a view's points, world frame, metres."""
    return moved(view.points[:: max(len(view.points) // _ENOUGH, 1)], view.pose)


def _outside_mask(cloud: Array, view: View) -> Array:
    """As many points of the whole image as lie in its mask."""
    image = view.image
    if image is None or image.labels is None or not len(cloud):
        return np.empty((0, 3))
    points = _core.unproject(image.depth, *image.camera)
    return moved(points[:: max(len(points) // len(cloud), 1)], view.pose)
