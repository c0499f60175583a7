"""Make a view from a decoded message."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES
from strand.io.recordings.camera_info import Calibration
from strand.io.recordings.depth_messages import MILLIMETER, decode_compressed_image, decode_image
from strand.io.recordings.point_messages import decode_points
from strand.support.checks import Array
from strand.views.view import View


def make_view(
    message: Any,
    camera: Calibration | None,
    pose: ArrayLike | None,
    depth_scale: float | None = None,
    max_bytes: int = MAX_BYTES,
    find_colors: Callable[[Array, Array], NDArray[np.uint8]] | None = None,
) -> View:
    """Make a view from an Image, CompressedImage or PointCloud2; raise ValueError if it is unsuitable.

    `find_colors` returns the colours of a depth image's pixels, for its depths, metres, and its pinhole
    matrix.
    """
    if hasattr(message, "point_step"):
        points, colors = decode_points(message)
        finite = np.isfinite(points).all(axis=1)
        return View(points[finite], pose, int((~finite).sum()), None if colors is None else colors[finite])
    compressed = not hasattr(message, "encoding")
    depth = decode_compressed_image(message, max_bytes) if compressed else decode_image(message)
    if depth.dtype.kind == "f":
        depth_scale = None
    elif depth_scale is None:
        if not compressed and message.encoding == "mono16":
            raise ValueError("encoding: mono16 has no unit; give depth_scale (--depth-scale)")
        depth_scale = MILLIMETER
    if camera is None:
        raise ValueError("depth images need a CameraInfo")
    if camera.size not in (None, depth.shape):
        sizes = [f"{width} x {height}" for height, width in (camera.size, depth.shape)]
        raise ValueError(f"CameraInfo: expected one for images of {sizes[1]} pixels, got {sizes[0]}")
    colors = None
    if find_colors is not None:
        metres = depth.astype(np.float64) * (1.0 if depth_scale is None else depth_scale)
        colors = find_colors(metres, camera.matrix)
    return View.from_depth(depth, camera.matrix, pose, colors, depth_scale=depth_scale)
