"""Outlier filter (section IV-A of *Shape Modeling of A String And Recognition Using Distance Sensor*)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.config import Filter
from strand.support.checks import Array
from strand.views.view import View

_MAX_REACH = 4.0  # radii: searching radii are not widened beyond this
_MIN_STEP = 1.02  # factor by which a searching radius is widened
_MAX_STEP = 1.5  # factor by which a searching radius is widened
_MANY = 100_000  # points: in views with more, neighbours are counted among some
_ENOUGH = 200  # neighbours that are counted then at least
_LEAST = 50  # neighbours that a point then needs at least
_SEED = 0  # of the points that are counted
_BESIDE = 0.25  # searching radii: points this near to some with enough neighbours have enough themselves


def drop_outliers(views: Sequence[View], radius: float, config: Filter, published: bool) -> list[View]:
    """Return views without the points that have too few neighbours in their own view.

    Parameters
    ----------
    views : sequence of View
    radius : float
        The rope's radius, metres.
    config : Filter
    published : bool
        Whether to do as published. Else the searching radius is widened in views that are coarse for the
        rope, and neighbours in very dense ones are counted among some of their points.
    """
    reach = config.radius * radius
    samples = [view.points if published else _sample_points(view.points, reach, config) for view in views]
    counts = _core.count_neighbors_each(samples, reach)
    kept = [
        _have_neighbors(sample, own, reach, radius, config, not published) if len(own) else None
        for sample, own in zip(samples, counts, strict=True)
    ]
    return [
        view if some is None else view.select(_spread(some, sample, view.points, reach))
        for view, sample, some in zip(views, samples, kept, strict=True)
    ]


def _sample_points(points: Array, reach: float, config: Filter) -> Array:
    """Return points; of many that lie much denser than counts need, one of every n."""
    # a share of the median must decide, and be many points, as it does among all points
    if len(points) <= _MANY or config.min_neighbors > _LEAST or not config.min_fraction:
        return points
    enough = max(_ENOUGH, _LEAST / config.min_fraction, config.widen_below)
    step = int(_core.count_typical_neighbors(points, reach) // enough)
    if step < 2:
        return points
    # chance decides which: of points in rows, every n-th ones may all lie on a few lines
    starts = np.arange(0, len(points) - step + 1, step)
    chosen = starts + np.random.default_rng(_SEED).integers(0, step, len(starts))
    return _core.copy_constant(points[chosen])


def _spread(kept: NDArray[np.bool_], sample: Array, points: Array, reach: float) -> NDArray[np.bool_]:
    """Tell which points to keep, given which of a sample."""
    if len(sample) == len(points):
        return kept
    near = (_BESIDE * reach) ** 2
    return np.asarray(_core.find_squared_distances(points, np.compress(kept, sample, axis=0)) <= near)


def _have_neighbors(
    points: Array, counts: NDArray[np.int64], reach: float, radius: float, config: Filter, widen: bool
) -> NDArray[np.bool_]:
    """Tell which points have enough neighbours, given how many they have within a reach."""
    median = _core.find_median(counts.astype(np.float64))
    while widen and median < config.widen_below and reach < _MAX_REACH * radius:
        # on a surface counts grow with the square of the reach
        reach *= float(np.clip(np.sqrt(config.widen_below / max(median, 1.0)), _MIN_STEP, _MAX_STEP))
        counts = _core.count_neighbors(points, reach)
        median = _core.find_median(counts.astype(np.float64))
    return counts >= max(config.min_fraction * median, config.min_neighbors)
