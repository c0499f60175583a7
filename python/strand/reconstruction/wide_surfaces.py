"""Points that are no ropes: surfaces and clouds wider than ropes, found at a few places of each view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.support.checks import Array
from strand.views.view import View

_PLACES = 32  # places of a view that are looked at
_FIRST_PLACES = 13  # of these, places that are looked at first
_REACH = 5.0  # radii around a place
_WIDE_REACH = 10.0  # radii around a place, where noise may hide strands
_POINTS_PER_VOXEL = 20  # mean number of points that are kept in a voxel of two radii
_MIN_POINTS = 24  # points around a place
_WIDE_RATIO = 0.5  # second largest variance of points over the largest: with more, points are no strand
_FILLED_RATIO = 0.4  # least variance of points over the largest: with more, points fill space
_MIN_SHARE = 0.65  # of the places show wide points on a surface
_MIN_WIDE_SHARE = 0.8  # of the places show wide points on a surface within the wide reach
_NORMAL_REACH = 1.2  # radii around a point, whose points give its normal
_SMOOTH_SHARE = 0.9  # of the normals' squares along one direction: more on a surface, less across strands
_ROUGH = 0.2  # thickness over width of the points of a normal: with more, noise hides strands
_NORMALS = 24  # normals around a place
_MIN_NORMAL_POINTS = 8  # points that give a normal


def describe_surface(views: Sequence[View], radius: float) -> str | None:
    """Say what points show that are no ropes, such as a table, a wall, a body or noise; None if they may be.

    Points are no ropes if they spread in two directions, farther than ropes do, at nearly all places of each
    view. Across strands that lie side by side, unlike on a surface, normals turn.

    Parameters
    ----------
    views : sequence of View
        The middle one, the first and the last with points are looked at.
    radius : float
        The thickest rope's, metres.

    Returns
    -------
    str or None
        What the points look like, and what to give instead.
    """
    seeing = [view for view in views if len(view.points) >= _MIN_POINTS]
    found: list[str] = []
    for number in dict.fromkeys((len(seeing) // 2, 0, len(seeing) - 1) if seeing else ()):
        what = _classify_points(seeing[number].points, radius)
        if what is None:
            return None
        found.append(what)
    if not found:
        return None
    return (
        f"the points look like {found[0]}, wider than ropes of radius {radius:.3g} m; give an extraction "
        "range (bounds) or masks of the ropes alone, and the radius in metres"
    )


def _classify_points(points: Array, radius: float) -> str | None:
    """Say what the points of one view look like; None if they may be ropes."""
    voxels = _core.count_voxels([points], 2.0 * radius)
    points = points[:: max(len(points) // (_POINTS_PER_VOXEL * max(voxels, 1)), 1)]
    places = points[:: max(len(points) // _PLACES, 1)][:_PLACES]
    wide, shapes = _find_wide_places(points, places, _REACH * radius, _MIN_SHARE)
    if not len(shapes):
        return None
    if _core.find_median(shapes[:, 0] / shapes[:, 2]) > _FILLED_RATIO:
        return "a cloud that fills space"
    smooth, rough = _measure_normals(points, wide, radius)
    if smooth > _SMOOTH_SHARE:
        return "a smooth surface"
    if rough > _ROUGH and len(_find_wide_places(points, places, _WIDE_REACH * radius, _MIN_WIDE_SHARE)[1]):
        return "a rough surface"
    return None


def _find_wide_places(points: Array, places: Array, reach: float, share: float) -> tuple[Array, Array]:
    """Return the places where points are wide, and their variances there; none if there are few places."""
    few = _core.measure_variances(points, places[:_FIRST_PLACES], reach, _MIN_POINTS)
    # the first few places show most ropes
    if np.count_nonzero(few[:, 1] <= _WIDE_RATIO * few[:, 2]) > (1.0 - share) * len(places):
        return places[:0], few[:0]
    shapes = np.concatenate(
        [few, _core.measure_variances(points, places[_FIRST_PLACES:], reach, _MIN_POINTS)]
    )
    silent = int(np.isnan(shapes[:, 0]).sum())
    wide = shapes[:, 1] > _WIDE_RATIO * shapes[:, 2]
    if wide.sum() < share * (len(places) - silent) or 2 * silent > len(places):
        wide[:] = False
    return places[wide], shapes[wide]


def _measure_normals(points: Array, places: Array, radius: float) -> tuple[float, float]:
    """Return the share of the normals' squares along one direction, and the points' thickness; medians."""
    along, thick = [], []
    for place in places:
        away = points - place
        near = away[(away * away).sum(axis=1) < (_REACH * radius) ** 2]
        tensor, ratios = np.zeros((3, 3)), []
        for center in near[:: max(len(near) // _NORMALS, 1)]:
            away = near - center
            patch = away[(away * away).sum(axis=1) < (_NORMAL_REACH * radius) ** 2]
            if len(patch) >= _MIN_NORMAL_POINTS:
                values, vectors = np.linalg.eigh(_compute_covariance(patch))
                tensor += np.outer(vectors[:, 0], vectors[:, 0])
                ratios.append(values[0] / max(values[1], np.finfo(float).tiny))
        if ratios:
            along.append(float(np.linalg.eigvalsh(tensor)[2]) / len(ratios))
            thick.append(float(np.median(ratios)))
    # points too few for normals do not show strands
    return (float(np.median(along)), float(np.median(thick))) if along else (0.0, np.inf)


def _compute_covariance(points: Array) -> Array:
    from_mean = points - points.mean(axis=0)
    return np.asarray(from_mean.T @ from_mean / len(points))
