"""Detect depth that was measured along the rays instead of the camera's axis: it bends tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.reconstruction.color_masks.near_table import select_seen
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.view import View

_MAX_VIEWS = 3  # views that are looked at
_SAMPLE = 1000  # points of each, about
_MIN_POINTS = 250  # points of each
_CELLS = 12  # cells along each side of a plan of the points
_MIN_FILLED = 0.5  # share of the cells that the points of a table fill; those of ropes alone do not
_MAX_SCATTER = 0.0125  # share of the distance: a standard deviation about a table
_MIN_RATIO = 1.5  # of the scatters with and without the rays' lengths; lenses and sensors bend a table less
_BENT_DOUBT = 20.0  # doubt: it is certain, and stands first


def doubt_bent_tables(views: Sequence[View]) -> Doubt | None:
    """Doubt depth that bends a table which is flat once depth is divided by the rays' lengths.

    On a plane, the inverse of z is linear in x / z and y / z. Depths r along the rays are z times the rays'
    lengths q = |(x, y, z)| / z, so that q / r is linear instead. Each view shows which of the two holds.

    Parameters
    ----------
    views : sequence of View
        Uncropped.

    Returns
    -------
    Doubt or None
        None if the first view with a table shows it flat, or more than half of them do.
    """
    some = views if len(views) <= _MAX_VIEWS else (views[0], views[len(views) // 2], views[-1])
    found, bent = 0, []
    for view in some:
        scatters = measure_table(view)
        if scatters is None:
            continue
        found += 1
        if scatters[0] > _MIN_RATIO * scatters[1]:
            bent.append(scatters)
        elif not bent:
            # a mistake of all depths shows in the first table
            return None
    if not bent or 2 * len(bent) < found:
        return None
    as_given, divided = np.median(bent, axis=0)
    reason = (
        "depth looks as if it was measured along the rays, not along the camera's axis: the table is flat "
        f"to {1e3 * divided:.1f} mm a metre if depth is divided by the rays' lengths |(x, y, z)| / z, and to "
        f"{1e3 * as_given:.1f} mm as it is"
    )
    return Doubt("depth", _BENT_DOUBT, "where the ropes are", reason)


def measure_table(view: View) -> tuple[float, float] | None:
    """Return how far a view's depths scatter about a table: as they are, and divided by the rays' lengths.

    Returns
    -------
    (float, float) or None
        Robust standard deviations, as a share of the distance; None if the view shows no table.
    """
    x, y, z = _sample_points(view).T
    if len(z) < _MIN_POINTS or not (z > 0).all():
        return None
    plan = np.stack([x / z, y / z])
    if not _fills_plan(plan):
        return None
    rays, slopes = np.sqrt(1.0 + (plan**2).sum(axis=0)), plan.T
    scatters = (
        _core.measure_linear_scatter(slopes, 1.0 / z, z),
        _core.measure_linear_scatter(slopes, rays / z, z / rays),
    )
    return scatters if min(scatters) < _MAX_SCATTER else None


def _fills_plan(plan: Array) -> bool:
    """Tell whether (2, N) places fill most of their bounding rectangle."""
    low, high = plan.min(axis=1, keepdims=True), plan.max(axis=1, keepdims=True)
    cells = np.minimum((_CELLS * (plan - low) / np.maximum(high - low, 1e-12)).astype(np.int64), _CELLS - 1)
    return int(np.count_nonzero(np.bincount(_CELLS * cells[0] + cells[1]))) >= _MIN_FILLED * _CELLS**2


def _sample_points(view: View) -> Array:
    """(N, 3) Return some of all that a view saw, camera frame, metres."""
    image = view.image
    if image is None:
        return view.points[:: max(len(view.points) // _SAMPLE, 1)]
    rows, columns = select_seen(image.depth, _SAMPLE)
    return image.camera.lift(rows, columns, image.depth[rows, columns])
