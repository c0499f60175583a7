"""A view of one message."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand.io.budget import MAX_BYTES
from strand.io.recordings.camera_info import Pinhole
from strand.io.recordings.depth_messages import MILLIMETRE, decode_compressed_image, decode_image
from strand.io.recordings.point_messages import decode_points
from strand.views.view import View


def make_view(
    message: Any,
    camera: Pinhole | None,
    pose: ArrayLike | None,
    depth_scale: float | None = None,
    max_bytes: int = MAX_BYTES,
) -> View:
    """Make a view of an Image, CompressedImage or PointCloud2.

    Raises
    ------
    ValueError
        If it holds no depth or points, or is damaged.
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
            raise ValueError("encoding: mono16 has no unit; depth_scale= (--depth-scale) says it")
        depth_scale = MILLIMETRE
    if camera is None:
        raise ValueError("depth images need a CameraInfo")
    if camera.size not in (None, depth.shape):
        sizes = [f"{width} x {height}" for height, width in (camera.size, depth.shape)]
        raise ValueError(f"CameraInfo: it is of images of {sizes[0]} pixels, and this one has {sizes[1]}")
    return View.from_depth(depth, camera.matrix, pose, depth_scale=depth_scale)
