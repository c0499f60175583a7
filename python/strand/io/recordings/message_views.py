"""Make a view from a decoded message."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES, Budget
from strand.io.recordings.camera_info import Calibration
from strand.io.recordings.depth_messages import (
    MILLIMETER,
    decode_compressed_image,
    decode_image,
    find_size,
)
from strand.io.recordings.mask_messages import decode_mask_message
from strand.io.recordings.point_messages import decode_points
from strand.support.checks import Array
from strand.views.view import View

FindColors = Callable[[Array, Array, Budget], NDArray[np.uint8]]
_NUMBERS = 6  # of a point: three of its place, three of its colour
_FLOAT = 8  # bytes of a number
_METRES = 8  # bytes of a pixel's depth while its colour is found
# a caller may still hold the view of the message before
_VIEWS = 2  # views in memory


def make_view(
    message: Any,
    camera: Calibration | None,
    pose: ArrayLike | None,
    depth_scale: float | None = None,
    budget: Budget | None = None,
    find_colors: FindColors | None = None,
    stamp: float | None = None,
    masks: Mapping[str, Any] | None = None,
) -> View:
    """Make a view from an Image, CompressedImage or PointCloud2; raise ValueError if it is unsuitable.

    An image that declares another size than its CameraInfo, or more than fits in the budget, is not decoded.
    `find_colors` returns the colours of a depth image's pixels, for its depths, metres, its pinhole matrix
    and the budget. `stamp` is the view's, seconds. `masks` has the messages of its "mask" and "occluders".
    """
    budget = Budget(MAX_BYTES) if budget is None else budget
    if hasattr(message, "point_step"):
        return _make_cloud(message, pose, budget, stamp)
    if camera is None:
        raise ValueError("depth images need a CameraInfo")
    size = find_size(message)
    if camera.size not in (None, size):
        sizes = [f"{width} x {height}" for height, width in (camera.size or size, size)]
        raise ValueError(f"CameraInfo: expected one for images of {sizes[1]} pixels, got {sizes[0]}")
    pixels = size[0] * size[1]
    with budget.hold_view("data", pixels, _VIEWS):
        compressed = not hasattr(message, "encoding")
        depth = decode_compressed_image(message, budget) if compressed else decode_image(message)
        if depth.dtype.kind == "f":
            depth_scale = None
        elif depth_scale is None:
            if not compressed and message.encoding == "mono16":
                raise ValueError("encoding: mono16 has no unit; give depth_scale (--depth-scale)")
            depth_scale = MILLIMETER
        colors = None
        if find_colors is not None:
            for _ in range(_VIEWS):
                budget.take_image("data", "color", pixels)
            with budget.hold("data", _METRES * pixels):
                metres = depth.astype(np.float64) * (1.0 if depth_scale is None else depth_scale)
                colors = find_colors(metres, camera.matrix, budget)
        labels = {name: decode_mask_message(name, one, size) for name, one in (masks or {}).items()}
        return View.from_depth(
            depth, camera.matrix, pose, colors, depth_scale=depth_scale, stamp=stamp, **labels
        )


def _make_cloud(message: Any, pose: ArrayLike | None, budget: Budget, stamp: float | None) -> View:
    numbers = _NUMBERS * int(message.height) * int(message.width)
    with budget.hold("data", len(message.data)), budget.hold_cloud("data", numbers):
        budget.take("data", _FLOAT * numbers)
        points, colors = decode_points(message)
        finite = np.isfinite(points).all(axis=1)
        colors = None if colors is None else colors[finite]
        return View(points[finite], pose, int((~finite).sum()), colors, stamp=stamp)
