"""Which of the arcs that were traced with several radii are rope."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.support.checks import Array

# residuals beyond this explain nothing, in smallest radii
_LIMIT = 0.4
# least half width of the strip that an arc's points make, in its radii: for a tube too wide it is narrow
_LEAST_WIDTH = 0.7
# an arc is left out if the others explain its points but for this share of what it explains alone
_LEAST_LOSS = 0.3


def best_explaining(
    classes: Sequence[int], radii: Array, fitted: Callable[[list[int]], TubeFit]
) -> NDArray[np.bool_]:
    """Choose the arcs that together explain the points best.

    A point with the residual e, limited to 0.4 of the smallest radius, costs e^2. Arcs are taken one after
    another, each time the one that lowers the cost most. At last those are left out that hardly lower it
    among the others: a wide tube over two strands, a narrow one inside a rope. Arcs of one radius are
    assumed to share no points.

    Parameters
    ----------
    classes : sequence of int
        For each arc the number of its radius.
    radii : (K,) ndarray
        Metres.
    fitted : callable
        Finds the foot points of all points on some of the arcs, chosen by their numbers.

    Returns
    -------
    (A,) ndarray of bool
    """
    limit = _LIMIT * float(radii.min())
    saved, owner = [], []
    for radius_class in sorted(set(classes)):
        mine = [number for number, other in enumerate(classes) if other == radius_class]
        fit = fitted(mine)
        gain = np.where(fit.explained, np.maximum(limit**2 - fit.residual**2, 0.0), 0.0)
        wide = np.array(
            [_width(fit, i, radii[radius_class], limit) >= _LEAST_WIDTH for i in range(len(mine))]
        )
        saved.append(gain * wide[fit.curve])
        owner.append(np.array(mine)[fit.curve])
    gains, owners = np.array(saved), np.array(owner)
    count = len(classes)

    def of_arcs(values: Array) -> Array:
        """Sum over each arc's points."""
        return np.asarray(np.bincount(owners.ravel(), values.ravel(), count), dtype=np.float64)

    alone = of_arcs(gains)
    chosen = np.zeros(count, dtype=bool)
    best = np.zeros(gains.shape[1])
    while True:
        more = np.where(chosen, 0.0, of_arcs(np.maximum(gains - best, 0.0)))
        arc = int(more.argmax())
        if more[arc] <= _LEAST_LOSS * alone[arc]:
            break
        chosen[arc] = True
        best = np.where(chosen[owners], gains, 0.0).max(axis=0)
    while chosen.any():
        held = np.where(chosen[owners], gains, 0.0)
        order = np.sort(held, axis=0)
        second = order[-2] if len(order) > 1 else np.zeros_like(best)
        loss = np.where(chosen, of_arcs(np.maximum(held - second, 0.0)) / np.maximum(alone, 1e-300), np.inf)
        arc = int(loss.argmin())
        if loss[arc] >= _LEAST_LOSS:
            break
        chosen[arc] = False
    return chosen


def _width(fit: TubeFit, number: int, radius: float, limit: float) -> float:
    """Half the width of the strip that an arc's points make for their cameras, in radii."""
    mine = fit.explained & (fit.curve == number) & (np.abs(fit.residual) < limit)
    if np.count_nonzero(mine) < 3:
        return 0.0
    curve = Curve.whole(fit.curves[number])
    axis, tangent, _ = curve.at(curve.arc_length_at(fit.parameter[mine]))
    aside = np.cross(fit.to_camera[mine], tangent)
    aside /= np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), 1e-300)
    lateral = ((fit.points[mine] - axis) * aside).sum(axis=1)
    return float(np.sqrt(3.0 * (lateral**2).mean())) / radius
