"""Errors of depth images: how far they reach from pixel to pixel, and the step between depths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.support.checks import Array
from strand.support.robust import DEVIATION_OF_MEDIAN

MIN_CORRELATION = 0.1  # of neighbouring pixels: errors that are less correlated count as independent
_SIDE = 40  # pixels: side of the windows that planes are fitted to
_MAX_WINDOWS = 40  # windows of each image that planes are fitted to
_MAX_USED = 8  # windows of each image that are used
_MIN_WINDOWS = 2  # windows of all images together: fewer give no correlation
_MAX_MISSING = 0.05  # share of a window's pixels that may have no depth
_FILLINGS = 3  # fits after which these are on the plane of the others
_MAX_ERROR = 6.0  # standard deviations: a window with a larger residual shows no plane
_NARROW_SHARE = 0.25  # quantile of the windows' standard deviations that a plane is expected to have
_MAX_WIDTH = 1.5  # times that quantile: wider residuals are those of no plane
_MAX_DISTINCT = 0.8  # share of the depths: where more of them differ, depth has no step
_ROUNDING = 1e-9  # share of the depth: smaller differences come from rounding

_AXIS = (np.arange(_SIDE) - 0.5 * (_SIDE - 1)) / _SIDE  # columns of a window, in its sides from its middle
# (3, side * side) terms of a linear function over a window: 1, column and row
_TERMS = np.stack([np.ones((_SIDE, _SIDE)), *np.meshgrid(_AXIS, _AXIS)]).reshape(3, -1)
_FIT = np.linalg.pinv(_TERMS)  # (side * side, 3) values of a window to the terms' coefficients


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
    found = [window for image, depth in images for window in _compute_plane_residuals(image, depth)]
    if len(found) < _MIN_WINDOWS:
        return [], 0.0
    errors = np.stack(found).reshape(-1, _SIDE, _SIDE)
    power = (errors**2).mean()
    correlations = []
    for lag in range(1, lags + 1):
        in_row = (errors[:, :, lag:] * errors[:, :, :-lag]).mean()
        in_column = (errors[:, lag:] * errors[:, :-lag]).mean()
        correlations.append(float(0.5 * (in_row + in_column) / power))
    return correlations, len(_TERMS) / _SIDE**2


def _compute_plane_residuals(image: Array, depth: float) -> Array:
    """Return (P, side * side) residuals of windows that show a plane, in standard deviations."""
    rows, columns = image.shape[0] // _SIDE, image.shape[1] // _SIDE
    blocks = image[: rows * _SIDE, : columns * _SIDE].reshape(rows, _SIDE, columns, _SIDE)
    missing = ~((blocks > 0.0) & (blocks < np.inf))
    # along rows of the image first, which lie together
    counts = missing.sum(axis=1, dtype=np.uint8).sum(axis=2, dtype=np.int64)
    full = np.argwhere(counts < _MAX_MISSING * _SIDE**2)
    if not len(full):
        return np.empty((0, _SIDE**2))
    used = full[:: -(-len(full) // _MAX_WINDOWS)]
    windows = blocks[used[:, 0], :, used[:, 1]].reshape(len(used), -1)
    bare = missing[used[:, 0], :, used[:, 1]].reshape(len(used), -1)
    nearness = 1.0 / np.where(bare, np.inf, windows)
    # single pixels without depth are on the plane of the others
    for _ in range(_FILLINGS if bare.any() else 0):
        nearness = np.where(bare, (nearness @ _FIT) @ _TERMS, nearness)
    windows = np.where(bare, 1.0 / nearness, windows)
    order = np.argsort(np.abs(windows.mean(axis=1) - depth), kind="stable")
    windows, nearness = windows[order], nearness[order]
    errors = nearness - (nearness @ _FIT) @ _TERMS
    sd = DEVIATION_OF_MEDIAN * np.median(np.abs(errors), axis=1)
    # metres: residuals of anything but a plane are wider than those of planes
    wide = sd * windows.mean(axis=1) ** 2
    plane = (np.abs(errors).max(axis=1) < _MAX_ERROR * sd) & (sd > 0.0)
    plane &= wide < _MAX_WIDTH * np.quantile(wide, _NARROW_SHARE)
    return np.asarray(errors[plane][:_MAX_USED] / sd[plane][:_MAX_USED, None])


def find_depth_step(depth: Array) -> float:
    """Return the distance between neighboring depths of a sensor, metres; 0 if most differ, or none."""
    each = np.unique(depth)
    # depths that were computed from points differ by rounding
    gaps = np.diff(each)
    gaps = gaps[gaps > _ROUNDING * float(each[-1])]
    # a single depth shows no step
    if not 1 < len(gaps) + 1 < _MAX_DISTINCT * len(depth):
        return 0.0
    return float(np.median(gaps))
