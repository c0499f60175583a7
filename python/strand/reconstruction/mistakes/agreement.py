"""How far apart views show the same ropes: with poses, images and units that are right, hardly at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.view import View, cropped

# points of a view that are asked, and fewest that say anything; views with more than so many show more than
# ropes
_ASKED, _FEWEST, _MOST = 200, 30, 40_000
# cosine between directions of sight beyond which views show opposite sides of a rope
_OPPOSITE = -0.8


def apart(
    views: Sequence[View],
    bounds: Box | None,
    most: float,
    shown: Sequence[View] | None = None,
    opposite: float | None = None,
) -> float:
    """Return how far apart views show ropes, in the mean of each and the one before it.

    That is the median distance from points of one view to the nearest of the other. Points that the other has
    out of sight do not count.

    Parameters
    ----------
    views : sequence of View
        Whose points are ropes in bounds.
    bounds : Box or None
        The extraction range, metres.
    most : float
        Farther is as far as this, metres; a view that shows nothing in bounds is as far from the others.
    shown : sequence of View, optional
        The same views with the points of ropes alone, if they are known.
    opposite : float, optional
        How far apart views of opposite sides count as, metres: they show nothing in common. If it is not
        given they are left out, and are not apart if there are no others.

    Returns
    -------
    float
        Metres; infinite if none has another's ropes in sight; NaN if fewer than two show any, or if they show
        more than ropes.
    """
    if shown is None:
        shown = views if bounds is None else cropped(views, bounds)
    if more_than_ropes(shown) or sum(len(view.points) >= _FEWEST for view in shown) < 2:
        return float("nan")
    clouds = [view.world_points for view in shown]
    count = len(views)
    across = [_facing(cloud, view) for cloud, view in zip(clouds, views, strict=True)]
    found, against = [], 0
    for i in range(count):
        # of one rope opposite sides are as near each other as it is thick
        if across[i] @ across[i - 1] < _OPPOSITE and _between(clouds[i], clouds[i - 1]) < most:
            against += 1
            found += [] if opposite is None else [opposite]
        else:
            found += _from_one_to_another(clouds[i], clouds[i - 1], views[i - 1], most)
    if against and not found:
        return 0.0
    return float(np.mean(found)) if found else float("inf")


def more_than_ropes(shown: Sequence[View]) -> bool:
    """Tell whether a view shows so much that most of it is no rope."""
    return max(len(view.points) for view in shown) > _MOST


def _from_one_to_another(own: Array, other: Array, view: View, most: float) -> Iterator[float]:
    asked = _some(own)
    asked = asked[_in_sight(asked, view)]
    if len(asked) < _FEWEST:
        return
    if len(other) < _FEWEST:
        yield most
        return
    yield min(_between(asked, other), most)


def _some(points: Array) -> Array:
    return points[:: max(len(points) // _ASKED, 1)]


def _between(own: Array, other: Array) -> float:
    """Median distance from points to the nearest of others, metres; infinite if there are none of either."""
    if not len(own) or not len(other):
        return float("inf")
    return float(np.sqrt(np.median(_core.squared_distances(_some(own), other))))


def _in_sight(points: Array, view: View) -> NDArray[np.bool_]:
    """Which points of the world lie before a view's image; of a view of points, no farther out than these."""
    image = view.image
    seen = (points - view.pose[:3, 3]) @ view.pose[:3, :3]
    if image is None:
        own, asked = _directions(view.points), _directions(seen)
        middle = own.sum(axis=0)
        return np.asarray(asked @ middle >= (own @ middle).min(initial=np.inf))
    height, width = image.depth.shape
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u, v = image.camera.project(seen).T
    return np.asarray((seen[:, 2] > 0) & (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5))


def _directions(points: Array) -> Array:
    """(N, 3) Unit vectors from a camera to points of its frame."""
    return np.asarray(points / np.maximum(np.linalg.norm(points, axis=1), np.finfo(float).tiny)[:, None])


def _facing(cloud: Array, view: View) -> Array:
    """(3,) The direction in which a view sees its ropes, world frame."""
    if not len(cloud):
        return np.zeros(3)
    towards = cloud.mean(axis=0) - view.viewpoint
    return np.asarray(towards / max(float(np.linalg.norm(towards)), np.finfo(float).tiny))
