"""How far a sensor's errors reach from pixel to pixel, from flat surroundings of the ropes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.support.checks import Array
from strand.support.robust import DEVIATION_OF_MEDIAN

# side of the windows that planes are fitted to, pixels
_SIDE = 40
# windows that are looked at and used in each image, and those that are enough in all
_LOOKED_AT, _USED, _FEWEST = 40, 8, 2
# in a plane's window no error is larger, in standard deviations
_LARGEST = 6.0
# residuals are at most so many times as wide as those of this share of the windows
_WIDER, _NARROW = 1.5, 0.25


def plane_correlations(images: Sequence[tuple[Array, float]], lags: int) -> tuple[list[float], float]:
    """Correlate the errors of pixels that see planes.

    On a plane 1 / z is linear in the pixel's column and row, so a plane is fitted to each of some windows;
    those that show anything else are left out.

    Parameters
    ----------
    images : sequence of ((H, W) ndarray, float)
        Depths, metres, 0 or NaN for none; and the depth of the ropes there: windows at such depths are the
        first to be used.
    lags : int

    Returns
    -------
    correlations : list of float
        Of residuals of pixels 1, 2, ... apart in a row or a column.
    followed : float
        Unknowns that were fitted, for each pixel; 0 where hardly a window shows a plane.
    """
    axis = (np.arange(_SIDE) - 0.5 * (_SIDE - 1)) / _SIDE
    terms = np.stack([np.ones((_SIDE, _SIDE)), *np.meshgrid(axis, axis)]).reshape(3, -1)
    fits = np.linalg.pinv(terms)
    found = []
    for image, depth in images:
        height, width = image.shape
        rows, columns = range(0, height - _SIDE + 1, _SIDE), range(0, width - _SIDE + 1, _SIDE)
        corners = [(row, column) for row in rows for column in columns]
        if not corners:
            continue
        step = -(-len(corners) // _LOOKED_AT)
        windows = np.stack([image[r : r + _SIDE, c : c + _SIDE] for r, c in corners[::step]])
        windows = windows.reshape(len(windows), -1)
        windows = windows[(np.isfinite(windows) & (windows > 0.0)).all(axis=1)]
        windows = windows[np.argsort(np.abs(windows.mean(axis=1) - depth), kind="stable")]
        nearness = 1.0 / windows
        errors = nearness - (nearness @ fits) @ terms
        sd = DEVIATION_OF_MEDIAN * np.median(np.abs(errors), axis=1)
        if not len(sd):
            continue
        # in metres: what is no plane has wider residuals than those that are
        wide = sd * windows.mean(axis=1) ** 2
        plane = (np.abs(errors).max(axis=1) < _LARGEST * sd) & (sd > 0.0)
        plane &= wide < _WIDER * np.quantile(wide, _NARROW)
        found.extend(errors[plane][:_USED] / sd[plane][:_USED, None])
    if len(found) < _FEWEST:
        return [], 0.0
    errors = np.stack(found).reshape(-1, _SIDE, _SIDE)
    power = (errors**2).mean()
    correlations = []
    for lag in range(1, lags + 1):
        in_row = (errors[:, :, lag:] * errors[:, :, :-lag]).mean()
        in_column = (errors[:, lag:] * errors[:, :-lag]).mean()
        correlations.append(float(0.5 * (in_row + in_column) / power))
    return correlations, len(terms) / _SIDE**2
