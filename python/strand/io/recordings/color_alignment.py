"""Colours of depth pixels from another camera: each pixel's point is projected into the colour image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.recordings.camera_info import Calibration
from strand.support.checks import Array
from strand.views.pinhole import Pinhole

_MIN_DEPTH = 1e-6  # metres before the colour camera: points behind it take the colour at the border
_FILLING = 72  # bytes of a pixel while gaps of the depth are filled
_PROJECTING = 256  # bytes of a pixel while its colour is found
_PIXELS = 1 << 16  # pixels whose colours are found at once
_MAX_SLOPE = 10.0  # of a ray in the colour camera: the lens model holds for less


@dataclass(frozen=True, eq=False)
class ColorCamera:
    """The camera of a colour topic.

    Attributes
    ----------
    topic : str
    frame : str
        Its TF frame.
    calibration : Calibration or None
        None: its pixels are those of the depth image.
    """

    topic: str
    frame: str
    calibration: Calibration | None


def align_colors(
    colors: NDArray[np.uint8], camera: ColorCamera, depth: Array, matrix: Array, pose: Array, budget: Budget
) -> NDArray[np.uint8]:
    """Return the (H, W, 3) colours of a depth image's pixels.

    A pixel without depth takes that of the farther of its neighbours in the row. A point outside the colour
    image takes the colour at the border.

    Parameters
    ----------
    colors : (h, w, 3) ndarray
        The colour camera's image.
    camera : ColorCamera
    depth : (H, W) ndarray
        Metres; 0 or NaN without a return.
    matrix : (3, 3) ndarray
        The depth camera's pinhole matrix.
    pose : (4, 4) ndarray
        Depth camera to colour camera.
    budget : Budget
        Memory limit for the steps between.
    """
    size, own = colors.shape[:2], camera.calibration
    same = own is None or np.allclose(own.matrix, matrix)
    if same and size == depth.shape and np.array_equal(pose, np.eye(4)):
        return colors
    if own is None or own.size not in (None, size):
        known = "no CameraInfo" if own is None or own.size is None else f"a CameraInfo of {own.size[::-1]}"
        raise ValueError(f"{camera.topic}: an image of {size[1]} x {size[0]} pixels has {known}")
    with budget.hold("data", _FILLING * depth.size + _PROJECTING * _PIXELS):
        filled = _fill_gaps(depth).ravel()
        found = np.empty((depth.size, 3), dtype=np.uint8)
        for start in range(0, depth.size, _PIXELS):  # some pixels at a time to save memory
            part = slice(start, start + _PIXELS)
            rows, columns = np.divmod(np.arange(start, start + len(filled[part])), depth.shape[1])
            points = Pinhole.from_matrix(matrix).lift(rows, columns, filled[part])
            v, u = _project(points @ pose[:3, :3].T + pose[:3, 3], own, size)
            found[part] = colors[v, u]
        return found.reshape(*depth.shape, 3)


def _project(points: Array, camera: Calibration, size: tuple[int, ...]) -> tuple[NDArray[np.int64], ...]:
    """Return the rows and columns of a colour image where points (N, 3) of its camera are seen."""
    z = np.maximum(points[:, 2:], _MIN_DEPTH)
    slopes = np.clip(points[:, :2] / z, -_MAX_SLOPE, _MAX_SLOPE)
    if camera.distortion is not None:
        slopes = _distort(slopes, camera.distortion)
    places = slopes * np.diag(camera.matrix)[:2] + camera.matrix[:2, 2]
    v, u = (np.clip(np.rint(places[:, k]), 0, size[1 - k] - 1).astype(np.int64) for k in (1, 0))
    return v, u


def _fill_gaps(depth: Array) -> Array:
    """Return depths in which pixels without a return have that of the farther neighbour in their row."""
    seen = np.isfinite(depth) & (depth > 0)
    if not seen.any():
        return np.ones(depth.shape)
    typical = float(np.median(depth[seen]))
    filled = np.empty(depth.shape)
    rows, last = max(1, _PIXELS // depth.shape[1]), depth.shape[1] - 1
    for top in range(0, len(depth), rows):  # some rows at a time to save memory
        part = slice(top, top + rows)
        there, places = seen[part], np.arange(depth.shape[1])
        known = np.where(there, depth[part], 0.0)
        before = np.maximum.accumulate(np.where(there, places, 0), axis=1)
        after = np.minimum.accumulate(np.where(there, places, last)[:, ::-1], axis=1)[:, ::-1]
        gaps = np.maximum(*(np.take_along_axis(known, each, axis=1) for each in (before, after)))
        filled[part] = np.where(there, depth[part], np.where(gaps > 0, gaps, typical))
    return filled


def _distort(slopes: Array, distortion: Array) -> Array:
    """Return where a lens shows rays of (..., 2) slopes: k1, k2, p1, p2, k3, k4, k5, k6 as in OpenCV."""
    k1, k2, p1, p2, k3, k4, k5, k6 = distortion
    x, y = slopes[..., 0], slopes[..., 1]
    r = x * x + y * y
    radial = (1.0 + r * (k1 + r * (k2 + r * k3))) / (1.0 + r * (k4 + r * (k5 + r * k6)))
    return np.stack(
        [
            x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x),
            y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )
