"""Points that are no ropes: surfaces and volumes wider than ropes, told from a few places of each view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.support.checks import Array
from strand.views.view import View

# so many places of a view are looked at, so many of them first, as far around as this, in radii; farther, if
# noise hides strands
_PLACES, _FIRST, _AROUND, _FARTHER = 32, 13, 5.0, 10.0
# mean number of points in a voxel of two radii that is enough, and fewest around a place that say anything
_ENOUGH, _FEWEST = 20, 24
# along a strand points have many times the variance that they have across; where the second largest variance
# is more than this share of the largest they are wide, and where the least is more than that, they fill space
_WIDE, _FILLED = 0.5, 0.4
# points that are wide at this share of the places are no ropes, unless they are strands side by side
_SHARE, _SHARE_FARTHER = 0.65, 0.8
# across these normals turn: on a smooth surface, one direction has more than this of the squares of normals,
# each of the points within so many radii; where points are thicker than this for their width, noise hides it
_NORMAL, _SMOOTH, _ROUGH = 1.2, 0.9, 0.2
# normals that are taken around a place, and fewest points of each
_NORMALS, _LEAST = 24, 8


def describe_surface(views: Sequence[View], radius: float) -> str | None:
    """Say what points are that cannot be ropes; None if they may be.

    They cannot if they are spread in two directions, farther than ropes are, at nearly all places of each
    view: a table that was left in, a wall, a body, noise. Strands that lie side by side differ from a surface
    by how their normals turn.

    Parameters
    ----------
    views : sequence of View
        The middle one, the first and the last are looked at, as far as they see something.
    radius : float
        The ropes' radius, metres; the largest if they differ.

    Returns
    -------
    str or None
        What they look like, and what to do.
    """
    seeing = [view for view in views if len(view.points) >= _FEWEST]
    found: list[str] = []
    for number in dict.fromkeys((len(seeing) // 2, 0, len(seeing) - 1) if seeing else ()):
        what = _looks_like(seeing[number].points, radius)
        if what is None:
            return None
        found.append(what)
    if not found:
        return None
    return (
        f"the points look like {found[0]}, wider than ropes of radius {radius:.3g} m; give an extraction "
        "range (bounds) or masks that leave out everything else, and the radius in metres"
    )


def _looks_like(points: Array, radius: float) -> str | None:
    """Say what the points of one view look like; None if they may be ropes."""
    voxels = _core.occupied_voxels([points], 2.0 * radius)
    points = points[:: max(len(points) // (_ENOUGH * max(voxels, 1)), 1)]
    places = points[:: max(len(points) // _PLACES, 1)][:_PLACES]
    wide, shapes = _wide_places(points, places, _AROUND * radius, _SHARE)
    if not len(shapes):
        return None
    if np.median(shapes[:, 0] / shapes[:, 2]) > _FILLED:
        return "a cloud that fills space"
    smooth, rough = _normals(points, wide, radius)
    if smooth > _SMOOTH:
        return "a smooth surface"
    if rough > _ROUGH and len(_wide_places(points, places, _FARTHER * radius, _SHARE_FARTHER)[1]):
        return "a rough surface"
    return None


def _wide_places(points: Array, places: Array, reach: float, share: float) -> tuple[Array, Array]:
    """Return the places where points are wide, and the points' variances there; none if they are few."""
    few = _core.variances_around(points, places[:_FIRST], reach, _FEWEST)
    # most ropes are told by the first few places
    if np.count_nonzero(few[:, 1] <= _WIDE * few[:, 2]) > (1.0 - share) * len(places):
        return places[:0], few[:0]
    shapes = np.concatenate([few, _core.variances_around(points, places[_FIRST:], reach, _FEWEST)])
    silent = int(np.isnan(shapes[:, 0]).sum())
    wide = shapes[:, 1] > _WIDE * shapes[:, 2]
    if wide.sum() < share * (len(places) - silent) or 2 * silent > len(places):
        wide[:] = False
    return places[wide], shapes[wide]


def _normals(points: Array, places: Array, radius: float) -> tuple[float, float]:
    """How much of the squares of normals is along one direction, and how thick points are there; medians."""
    along, thick = [], []
    for place in places:
        away = points - place
        near = away[(away * away).sum(axis=1) < (_AROUND * radius) ** 2]
        tensor, ratios = np.zeros((3, 3)), []
        for centre in near[:: max(len(near) // _NORMALS, 1)]:
            away = near - centre
            patch = away[(away * away).sum(axis=1) < (_NORMAL * radius) ** 2]
            if len(patch) >= _LEAST:
                values, vectors = np.linalg.eigh(_covariance(patch))
                tensor += np.outer(vectors[:, 0], vectors[:, 0])
                ratios.append(values[0] / max(values[1], np.finfo(float).tiny))
        if ratios:
            along.append(float(np.linalg.eigvalsh(tensor)[2]) / len(ratios))
            thick.append(float(np.median(ratios)))
    # too few points for normals are too few to tell strands
    return (float(np.median(along)), float(np.median(thick))) if along else (0.0, np.inf)


def _covariance(points: Array) -> Array:
    from_mean = points - points.mean(axis=0)
    return np.asarray(from_mean.T @ from_mean / len(points))
