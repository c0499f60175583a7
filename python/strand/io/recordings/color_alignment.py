"""Colours of depth pixels from another camera: each pixel's point is projected into the colour image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.io.recordings.camera_info import Calibration
from strand.support.checks import Array
from strand.views.pinhole import Pinhole

_MIN_DEPTH = 1e-6  # metres before the colour camera: points behind it take the colour at the border
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
    colors: NDArray[np.uint8], camera: ColorCamera, depth: Array, matrix: Array, pose: Array
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
    """
    size, own = colors.shape[:2], camera.calibration
    same = own is None or np.allclose(own.matrix, matrix)
    if same and size == depth.shape and np.array_equal(pose, np.eye(4)):
        return colors
    if own is None or own.size not in (None, size):
        known = "no CameraInfo" if own is None or own.size is None else f"a CameraInfo of {own.size[::-1]}"
        raise ValueError(f"{camera.topic}: an image of {size[1]} x {size[0]} pixels has {known}")
    rows, columns = np.mgrid[: depth.shape[0], : depth.shape[1]]
    points = Pinhole.from_matrix(matrix).lift(rows, columns, _fill_gaps(depth))
    points = points @ pose[:3, :3].T + pose[:3, 3]
    z = np.maximum(points[..., 2:], _MIN_DEPTH)
    slopes = np.clip(points[..., :2] / z, -_MAX_SLOPE, _MAX_SLOPE)
    if own.distortion is not None:
        slopes = _distort(slopes, own.distortion)
    places = slopes * np.diag(own.matrix)[:2] + own.matrix[:2, 2]
    v, u = (np.clip(np.rint(places[..., k]), 0, size[1 - k] - 1).astype(np.int64) for k in (1, 0))
    return colors[v, u]


def _fill_gaps(depth: Array) -> Array:
    """Return depths in which pixels without a return have that of the farther neighbour in their row."""
    seen = np.isfinite(depth) & (depth > 0)
    if not seen.any():
        return np.ones(depth.shape)
    known = np.where(seen, depth, 0.0)
    filled = []
    for way in (1, -1):
        mine, there = known[:, ::way], seen[:, ::way]
        last = np.maximum.accumulate(np.where(there, np.arange(depth.shape[1]), 0), axis=1)
        filled.append(np.take_along_axis(mine, last, axis=1)[:, ::way])
    gaps = np.maximum(*filled)
    return np.where(seen, depth, np.where(gaps > 0, gaps, float(np.median(depth[seen]))))


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
