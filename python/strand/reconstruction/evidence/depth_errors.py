"""Errors of depth images: how far they reach from pixel to pixel, and the step between depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.support.checks import Array

MIN_CORRELATION = 0.1  # of neighbouring pixels: errors that are less correlated count as independent
_SIDE = 40  # pixels: side of the windows that planes are fitted to
_MIN_WINDOWS = 2  # windows of all images together: fewer give no correlation
_MAX_DISTINCT = 0.8  # share of the depths: where more of them differ, depth has no step
_ROUNDING = 1e-9  # share of the depth: smaller differences come from rounding
_UNKNOWNS = 3  # of a plane


def correlate_on_planes(images: Sequence[tuple[Array, float]], lags: int) -> tuple[list[float], float]:
    """Correlate the depth errors of neighboring pixels that see planes.

    On a plane, 1 / z is linear in the pixel's column and row. A plane is fitted to each of some windows, and
    windows that show anything else are dropped.

    Parameters
    ----------
    images : sequence of ((H, W) ndarray, float)
        Depths, metres, 0 or NaN for none; and the depth of the ropes there. Windows near that depth are used
        first.
    lags : int

    Returns
    -------
    correlations : list of float
        For residuals of pixels 1, 2, ... apart in a row or a column; empty without enough planes.
    followed : float
        Fitted unknowns per pixel; 0 without enough planes.
    """
    found = [_core.measure_plane_errors(image, depth) for image, depth in images]
    errors = np.concatenate(found).reshape(-1, _SIDE, _SIDE) if found else np.empty(0)
    if len(errors) < _MIN_WINDOWS:
        return [], 0.0
    power = (errors**2).mean()
    correlations = []
    for lag in range(1, lags + 1):
        in_row = (errors[:, :, lag:] * errors[:, :, :-lag]).mean()
        in_column = (errors[:, lag:] * errors[:, :-lag]).mean()
        correlations.append(float(0.5 * (in_row + in_column) / power))
    return correlations, _UNKNOWNS / _SIDE**2


def find_depth_step(depth: Array) -> float:
    """Return the distance between neighboring depths of a sensor, metres; 0 if most differ, or none."""
    each = np.unique(depth)
    # depths that were computed from points differ by rounding
    gaps = np.diff(each)
    gaps = gaps[gaps > _ROUNDING * float(each[-1])]
    # a single depth shows no step
    if not 1 < len(gaps) + 1 < _MAX_DISTINCT * len(depth):
        return 0.0
    return _core.find_median(gaps)
