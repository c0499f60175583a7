"""Check that views agree: with right poses, images and units, they show ropes in the same place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.reconstruction.mistakes.undo import MISTAKES
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.extract import Extract
from strand.views.view import View

_SAMPLE = 200  # points of a view that are compared with another view
_MIN_POINTS = 30  # points that a view must show
_MAX_ROPE_POINTS = 40_000  # points of a view: with more, most of them are no ropes
_OPPOSITE_COSINE = -0.8  # of viewing directions: below it, two views show opposite sides of a rope
_MAX_COUNTED_DISTANCE = 10.0  # radii: larger distances count as this
_MAX_DISTANCE = 0.8  # radii: views that agree show ropes this close to each other
_MIN_GAIN = 2.0  # a mistake is named if undoing it brings views this many times closer
_NAMED_DOUBT = 20.0  # doubt: a named mistake is certain, and stands first
_MIN_DOUBTED_DISTANCE = 2.0  # radii: views this close raise no doubt of their poses
_DOUBT_PER_RADIUS = 0.4  # doubt for each radius of distance beyond `_MIN_DOUBTED_DISTANCE`
_MAX_DOUBT = 1.5  # doubt at any distance
_OUT_OF_SIGHT_DOUBT = 0.8  # doubt if no view shows the ropes of another
_TINY = float(np.finfo(float).tiny)  # least positive float: keeps ratios finite


@dataclass(frozen=True)
class Agreement:
    """The agreement of views about the place of the ropes.

    Attributes
    ----------
    distance : float
        As `measure_view_distance` gives it, metres; NaN for a single view.
    agrees : bool
        Whether it is as small as that of views that are right.
    known : bool
        Whether there are several views of ropes alone, and the distance shows whether they agree.
    """

    distance: float
    agrees: bool
    known: bool


def compare_views(
    views: Sequence[View], shown: Sequence[View], bounds: Box | None, radius: float
) -> Agreement:
    """Tell whether views agree.

    Parameters
    ----------
    views : sequence of View
        Uncropped.
    shown : sequence of View
        The same views with the points of ropes alone.
    bounds : Box or None
        The extraction range, metres. Without it, views out of each other's sight may show more than ropes.
    radius : float
        The thinnest rope's, metres.
    """
    distance = math.nan
    if len(views) > 1:
        distance = measure_view_distance(views, shown, _MAX_COUNTED_DISTANCE * radius)
    unknown = len(views) < 2 or _shows_more_than_ropes(shown) or (bounds is None and math.isnan(distance))
    return Agreement(distance, distance <= _MAX_DISTANCE * radius, not unknown)


def measure_view_distance(
    views: Sequence[View], shown: Sequence[View], farthest: float, opposite: float | None = None
) -> float:
    """Return the mean distance between the ropes in each view and those in the view before it.

    The distance of two views is the median distance from points of one to the nearest point of the other.
    Only points in the field of view of the other view count.

    Parameters
    ----------
    views : sequence of View
        Uncropped.
    shown : sequence of View
        The same views with the points of ropes alone.
    farthest : float
        Larger distances count as this, metres. So does the distance to a view that shows no ropes.
    opposite : float, optional
        Distance that views of opposite sides of a rope count as, metres, as they show no common points.
        Without it, these views are skipped; the result is 0 if there are no others.

    Returns
    -------
    float
        Metres. Infinite if no view shows points in the field of view of another. NaN if fewer than two views
        show points, or if a view shows more than ropes.
    """
    if _shows_more_than_ropes(shown) or sum(len(view.points) >= _MIN_POINTS for view in shown) < 2:
        return math.nan
    clouds = [view.world_points for view in shown]
    # from the cameras to the middles of their ropes
    towards = _core.find_centroids(clouds) - np.array([view.viewpoint for view in views])
    directions = _normalize(towards)
    found, skipped = [], 0
    for i in range(len(views)):
        # opposite sides of a rope are as close to each other as the rope is thick
        if (
            directions[i] @ directions[i - 1] < _OPPOSITE_COSINE
            and _measure_distance(clouds[i], clouds[i - 1]) < farthest
        ):
            skipped += 1
            found += [] if opposite is None else [opposite]
        else:
            found += _measure_in_sight(clouds[i], clouds[i - 1], views[i - 1], farthest)
    if skipped and not found:
        return 0.0
    return float(np.mean(found)) if found else math.inf


def explain_distance(
    views: Sequence[View], bounds: Box | None, radius: float, distance: float
) -> list[Doubt]:
    """Name the mistake without which views agree; without one, doubt the poses of views that disagree.

    If no view shows the ropes of another, they may show different ropes, but hardly ever do.

    Parameters
    ----------
    views : sequence of View
        Uncropped. Their points in bounds are ropes.
    bounds : Box or None
        The extraction range, metres.
    radius : float
        The thinnest rope's, metres.
    distance : float
        Between the views, metres.
    """
    without = [_measure_without(mistake.undo(views), bounds, radius) for mistake in MISTAKES]
    least = min(range(len(MISTAKES)), key=without.__getitem__)
    limit = " or more" if distance >= 0.99 * _MAX_COUNTED_DISTANCE * radius else ""
    shown = f"views disagree by {1e3 * distance:.1f} mm{limit} about where the ropes are"
    if not math.isfinite(distance):
        shown = "no view shows the ropes of another"
    if without[least] < _MAX_DISTANCE * radius and not without[least] > distance / _MIN_GAIN:
        mistake = MISTAKES[least]
        reason = f"{mistake.advice}; {shown}, {1e3 * without[least]:.1f} mm without that"
        return [Doubt(mistake.kind, _NAMED_DOUBT, "where the ropes are", reason)]
    amount = min(_DOUBT_PER_RADIUS * (distance / radius - _MIN_DOUBTED_DISTANCE), _MAX_DOUBT)
    if math.isinf(distance):
        amount = _OUT_OF_SIGHT_DOUBT
    if not amount > 0.0:
        return []
    asked = "are poses camera-to-world, in metres, of angles in radians, and each of its own image?"
    return [Doubt("pose", amount, "where the ropes are", f"{shown}; {asked}")]


def _measure_without(views: Sequence[View | None], bounds: Box | None, radius: float) -> float:
    """Return the distance between views without a mistake, metres; infinite if they cannot show it."""
    known = [view for view in views if view is not None]
    if len(known) < len(views):
        return math.inf
    farthest, extract = _MAX_COUNTED_DISTANCE * radius, Extract(tuple(known), bounds)
    distance = measure_view_distance(extract.whole, extract.inside, farthest, opposite=farthest)
    return math.inf if math.isnan(distance) else distance


def _shows_more_than_ropes(shown: Sequence[View]) -> bool:
    """Tell whether a view has so many points that most of them are no ropes."""
    return max(len(view.points) for view in shown) > _MAX_ROPE_POINTS


def _measure_in_sight(own: Array, other: Array, view: View, farthest: float) -> Iterator[float]:
    """Yield the distance from a cloud to that of another view, unless that view does not show the cloud."""
    sample = _sample(own)
    sample = sample[_are_in_sight(sample, view)]
    if len(sample) < _MIN_POINTS:
        return
    if len(other) < _MIN_POINTS:
        yield farthest
        return
    yield min(_measure_distance(sample, other), farthest)


def _sample(points: Array) -> Array:
    return points[:: max(len(points) // _SAMPLE, 1)]


def _measure_distance(own: Array, other: Array) -> float:
    """Return the median distance from points to the nearest of others, metres; infinite without points."""
    if not len(own) or not len(other):
        return float("inf")
    return math.sqrt(_core.find_median(_core.find_squared_distances(_sample(own), other)))


def _are_in_sight(points: Array, view: View) -> NDArray[np.bool_]:
    """Tell which points of the world lie in a view's image, or among the directions of its points."""
    image = view.image
    if image is None:
        seen = (points - view.pose[:3, 3]) @ view.pose[:3, :3]
        own, asked = _normalize(view.points), _normalize(seen)
        middle = own.sum(axis=0)
        return np.asarray(asked @ middle >= (own @ middle).min(initial=np.inf))
    # a point in no image has no depth behind it
    return ~np.isnan(_core.measure_behind(image.depth, image.camera, view.pose, points, 0.0))


def _normalize(vectors: Array) -> Array:
    """(N, 3) Return the directions of vectors; those of length 0 stay."""
    return np.asarray(vectors / np.maximum(measure_lengths(vectors), _TINY)[:, None])
