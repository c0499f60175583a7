"""Decode colour images from sensor_msgs: Image, and CompressedImage with a JPEG or PNG."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.image_parts import read_size
from strand.io.images import decode_color
from strand.io.recordings.depth_messages import is_depth

CHANNELS = {"rgb8": (0, 1, 2), "bgr8": (2, 1, 0), "rgba8": (0, 1, 2), "bgra8": (2, 1, 0)}
_GRAY = ("mono8", "mono16", "8UC1")  # encodings of infrared images, which compressed images may name
_PIXEL_BYTES = 3  # of a decoded pixel


def is_color(message: Any) -> bool:
    """Tell whether an Image or CompressedImage declares colour."""
    if hasattr(message, "encoding"):
        return message.encoding in CHANNELS
    kind = message.format.lower()
    gray = kind.partition(";")[0].strip() in [name.lower() for name in _GRAY]
    return not is_depth(message) and not gray and ("jpeg" in kind or "jpg" in kind or "png" in kind)


def decode_color_message(
    message: Any, budget: Budget, size: tuple[int, int] | None = None
) -> NDArray[np.uint8]:
    """Return the (H, W, 3) red, green and blue of an Image or CompressedImage.

    An image that declares another height and width than `size`, or more than fits, is not decoded.
    """
    if not hasattr(message, "encoding"):
        if not is_color(message):
            raise ValueError(
                f"format: expected colours compressed as JPEG or PNG, got {message.format[:60]!r}"
            )
        _check_size(size, read_size(memoryview(message.data)))
        budget.take("data", len(message.data))
        return decode_color("data", bytes(message.data), budget)
    if message.encoding not in CHANNELS:
        known = ", ".join(CHANNELS)
        raise ValueError(f"encoding: expected colours ({known}), got {message.encoding[:40]!r}")
    order, wide = CHANNELS[message.encoding], 4 if "a" in message.encoding else 3
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if height < 1 or width < 1:
        raise ValueError(f"width, height: expected pixels, got {width} x {height}")
    if step < width * wide or len(data) < step * (height - 1) + width * wide:
        raise ValueError(
            f"data: {width} x {height} pixels of {message.encoding} with rows of {step} bytes do not fit in "
            f"{len(data)} bytes"
        )
    _check_size(size, (height, width))
    budget.take("data", _PIXEL_BYTES * height * width)
    rows = np.lib.stride_tricks.as_strided(data, (height, width, wide), (step, wide, 1))
    return np.ascontiguousarray(rows[..., list(order)])


def _check_size(expected: tuple[int, int] | None, found: tuple[int, int]) -> None:
    if expected not in (None, found):
        sizes = [f"{width} x {height}" for height, width in (expected or found, found)]
        raise ValueError(f"CameraInfo: expected one for images of {sizes[1]} pixels, got {sizes[0]}")
