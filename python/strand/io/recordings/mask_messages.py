"""Decode masks from sensor_msgs/Image."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.recordings.depth_messages import read_pixels

_TYPES = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2"}  # NumPy's type of each encoding
_WHITE = 255  # pixels inside a mask that is a picture in black and white


def decode_mask_message(name: str, message: Any, size: tuple[int, int]) -> NDArray[Any]:
    """Return the (H, W) labels of an Image, or bools if its pixels are 0 and 255 alone.

    An image of another height and width than `size` raises ValueError, which names `name`.
    """
    if message.encoding not in _TYPES:
        known = ", ".join(_TYPES)
        raise ValueError(f"{name}: expected an Image of {known}, got {message.encoding[:40]!r}")
    if (int(message.height), int(message.width)) != size:
        raise ValueError(
            f"{name}: expected the depth image's {size[1]} x {size[0]} pixels, "
            f"got {message.width} x {message.height}"
        )
    labels = read_pixels(message, _TYPES[message.encoding])
    inside: NDArray[np.bool_] = labels != 0
    return inside if (labels[inside] == _WHITE).all() else labels
