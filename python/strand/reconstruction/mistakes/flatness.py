"""Whether depth was measured along the rays instead of the camera's axis: a table then looks bent."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.support.robust import robust_deviation
from strand.views.view import View

# views that are looked at, points of each, and fewest
_VIEWS, _POINTS, _FEWEST = 3, 1000, 300
# points of a table lie in this share of the cells of a plan of so many a side; points of ropes alone do not
_CELLS, _FILLED = 12, 0.5
# half of the points lie as near as this to a table, of their distance; rounds of the robust fit, and the
# deviations at which a point counts half
_NEAR, _ROUNDS, _ODD = 0.0125, 10, 2.0
# change of the scatter from round to round, as a part of it, below which a fit has settled
_SETTLED = 0.01
# depth is doubted where the table is so many times flatter with it over the rays' lengths; lenses and sensors
# that bend it are nowhere near. It is certain then, and told first
_FLATTER, _BENT = 1.5, 20.0


def bent_tables(views: Sequence[View]) -> Doubt | None:
    """Doubt depth with which a table is bent, and with which over the lengths of the rays it is flat.

    On a plane the inverse of z is linear in x / z and y / z. Depths r along the rays are z times the rays'
    lengths q = |(x, y, z)| / z, so that q / r is linear instead. Each view tells by itself which of the two.

    Parameters
    ----------
    views : sequence of View
        With all that they saw.

    Returns
    -------
    Doubt or None
        None if the first view with a table does not say so, or fewer than half of them.
    """
    some = views if len(views) <= _VIEWS else (views[0], views[len(views) // 2], views[-1])
    found, bent = 0, []
    for view in some:
        scatters = table_scatters(view)
        if scatters is None:
            continue
        found += 1
        if scatters[0] > _FLATTER * scatters[1]:
            bent.append(scatters)
        elif not bent:
            # what is wrong with all depths shows in the first table
            return None
    if not bent or 2 * len(bent) < found:
        return None
    as_given, divided = np.median(bent, axis=0)
    reason = (
        "depth looks as if it was measured along the rays, not along the camera's axis: the table is flat "
        f"to {1e3 * divided:.1f} mm a metre if depth is divided by the rays' lengths |(x, y, z)| / z, and to "
        f"{1e3 * as_given:.1f} mm as it is"
    )
    return Doubt("depth", _BENT, "where the ropes are", reason)


def table_scatters(view: View) -> tuple[float, float] | None:
    """Return how far depths scatter about a table as they are, and over the lengths of the rays.

    Parameters
    ----------
    view : View

    Returns
    -------
    (float, float) or None
        Standard deviations, robust, of the distance; None if there is no table.
    """
    x, y, z = _some_points(view).T
    if len(z) < _FEWEST or not (z > 0).all():
        return None
    slopes = np.column_stack([np.ones(len(z)), x / z, y / z])
    if not _side_by_side(slopes[:, 1:]):
        return None
    rays = np.linalg.norm(slopes, axis=1)
    scatters = _scatter(slopes, 1.0 / z, z), _scatter(slopes, rays / z, z / rays)
    return scatters if min(scatters) < _NEAR else None


def _side_by_side(plan: Array) -> bool:
    """Whether (N, 2) places fill most of a plan."""
    low, high = plan.min(axis=0), plan.max(axis=0)
    cells = np.minimum((_CELLS * (plan - low) / np.maximum(high - low, 1e-12)).astype(np.int64), _CELLS - 1)
    return len(np.unique(cells @ [_CELLS, 1])) >= _FILLED * _CELLS**2


def _some_points(view: View) -> Array:
    """(N, 3) Some of a view's points, of the whole image too, camera frame, metres."""
    image = view.image
    if image is None:
        return view.points[:: max(len(view.points) // _POINTS, 1)]
    flat: NDArray[np.intp] = np.flatnonzero(image.depth)
    rows, columns = np.divmod(flat[:: max(len(flat) // _POINTS, 1)], image.depth.shape[1])
    z = image.depth[rows, columns]
    return image.camera.unproject(rows, columns, z)


def _scatter(slopes: Array, inverse: Array, depth: Array) -> float:
    """How far inverse depths scatter about a linear function, over themselves; things on it count little."""
    weights, scatter = np.ones(len(depth)), np.inf
    for _ in range(_ROUNDS):
        before = scatter
        weighted = slopes * weights[:, None]
        linear = np.linalg.solve(weighted.T @ slopes, weighted.T @ inverse)
        off = (inverse - slopes @ linear) * depth
        scatter = robust_deviation(off)
        if abs(scatter - before) < _SETTLED * scatter:
            break
        weights = 1.0 / (1.0 + (off / max(_ODD * scatter, np.finfo(float).tiny)) ** 2)
    return scatter
