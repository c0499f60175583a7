"""Choose the arcs that are rope among those traced with several radii."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.support.checks import Array

_MAX_RESIDUAL = 0.4  # smallest radii: a larger residual explains nothing
_MIN_WIDTH = 0.7  # radii: half the strip that an arc's points fill; it is narrower if the tube is too wide
_MIN_LOSS = 0.3  # share of what an arc explains alone that the others must not explain


def choose_arcs(
    classes: Sequence[int], radii: Array, fit_some: Callable[[list[int]], TubeFit]
) -> NDArray[np.bool_]:
    """Choose the arcs that together explain the points best.

    A point costs its squared residual, up to a limit. Arcs are added one by one, each time the one that
    lowers the cost most. Then arcs that hardly lower it among the others are dropped: a wide tube over two
    strands, a narrow one inside a rope. Arcs of one radius are assumed to share no points.

    Parameters
    ----------
    classes : sequence of int
        Each arc's class of radius.
    radii : (K,) ndarray
        Metres.
    fit_some : callable
        Finds the foot points of all points on the arcs with the given numbers.

    Returns
    -------
    (A,) ndarray of bool
    """
    limit = _MAX_RESIDUAL * float(radii.min())
    saved, owner = [], []
    for radius_class in sorted(set(classes)):
        mine = [number for number, other in enumerate(classes) if other == radius_class]
        fit = fit_some(mine)
        gain = np.where(fit.explained, np.maximum(limit**2 - fit.residual**2, 0.0), 0.0)
        wide = np.array(
            [_measure_width(fit, i, radii[radius_class], limit) >= _MIN_WIDTH for i in range(len(mine))]
        )
        saved.append(gain * wide[fit.curve])
        owner.append(np.array(mine)[fit.curve])
    gains, owners = np.array(saved), np.array(owner)
    count = len(classes)

    def add_up(values: Array) -> Array:
        """Sum over each arc's points."""
        return np.asarray(np.bincount(owners.ravel(), values.ravel(), count), dtype=np.float64)

    alone = add_up(gains)
    chosen = np.zeros(count, dtype=bool)
    best = np.zeros(gains.shape[1])
    while True:
        more = np.where(chosen, 0.0, add_up(np.maximum(gains - best, 0.0)))
        arc = int(more.argmax())
        if more[arc] <= _MIN_LOSS * alone[arc]:
            break
        chosen[arc] = True
        best = np.where(chosen[owners], gains, 0.0).max(axis=0)
    while chosen.any():
        held = np.where(chosen[owners], gains, 0.0)
        order = np.sort(held, axis=0)
        second = order[-2] if len(order) > 1 else np.zeros_like(best)
        loss = np.where(chosen, add_up(np.maximum(held - second, 0.0)) / np.maximum(alone, 1e-300), np.inf)
        arc = int(loss.argmin())
        if loss[arc] >= _MIN_LOSS:
            break
        chosen[arc] = False
    return chosen


def _measure_width(fit: TubeFit, number: int, radius: float, limit: float) -> float:
    """Return half the width of the strip that an arc's points show to their cameras, radii."""
    mine = fit.explained & (fit.curve == number) & (np.abs(fit.residual) < limit)
    if np.count_nonzero(mine) < 3:
        return 0.0
    curve = Curve.whole(fit.curves[number])
    axis, tangent, _ = curve.at(curve.arc_length_at(fit.parameter[mine]))
    aside = np.cross(fit.to_camera[mine], tangent)
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-300)
    lateral = ((fit.points[mine] - axis) * aside).sum(axis=1)
    return float(np.sqrt(3.0 * (lateral**2).mean())) / radius
