"""Decode depth images from sensor_msgs: Image, and CompressedImage with a PNG."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.image_parts import read_size
from strand.io.images import decode_depth_png

MILLIMETER = 0.001  # metres: the unit of 16-bit depth, by REP 118
TYPES = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}  # NumPy's type of each encoding
_QUANTISED = 24  # bytes of a pixel while its float depth is found
_CODEC = struct.Struct("<iff")  # header before the PNG: format, and the quantisation's a and b


def is_depth(message: Any) -> bool:
    """Tell whether an Image or CompressedImage declares depth."""
    if hasattr(message, "encoding"):
        return message.encoding in ("16UC1", "32FC1")
    return message.format.partition(";")[0].strip() in ("16UC1", "32FC1")


def decode_image(message: Any) -> NDArray[Any]:
    """Return the (H, W) depths of an Image: uint16 in its unit, or float32 in metres."""
    if message.encoding not in TYPES:
        known = ", ".join(TYPES)
        raise ValueError(f"encoding: expected depth ({known}), got {message.encoding[:40]!r}")
    return read_pixels(message, TYPES[message.encoding])


def read_pixels(message: Any, kind: str) -> NDArray[Any]:
    """Return the (H, W) numbers of an Image with one channel, whose pixels are of NumPy's type `kind`."""
    number = np.dtype((">" if message.is_bigendian else "<") + kind)
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(message.data, dtype=np.uint8)
    if height < 1 or width < 1:
        raise ValueError(f"width, height: expected pixels, got {width} x {height}")
    if step < width * number.itemsize or len(data) < step * (height - 1) + width * number.itemsize:
        raise ValueError(
            f"data: {width} x {height} pixels of {message.encoding} with rows of {step} bytes do not fit "
            f"in {len(data)} bytes"
        )
    rows = np.lib.stride_tricks.as_strided(data, (height, width * number.itemsize), (step, 1))
    return np.ascontiguousarray(rows).view(number).astype(number.newbyteorder("="), copy=False)


def find_size(message: Any) -> tuple[int, int]:
    """Return the height and width that an Image or a CompressedImage with depth declares."""
    if hasattr(message, "encoding"):
        return int(message.height), int(message.width)
    return read_size(_open_compressed(message).png)


def decode_compressed_image(message: Any, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) depths of a CompressedImage: uint16 in its unit, or floats in metres.

    A "compressedDepth" message has 12 bytes before its PNG. Float depth z is quantised as the pixel v:
    z = a / (v - b). A pixel of 0 has no return.
    """
    found = _open_compressed(message)
    budget.take("data", len(found.png))
    numbers = decode_depth_png("data", bytes(found.png), budget)
    if found.encoding == "16UC1":
        return numbers
    with budget.hold("data", _QUANTISED * numbers.size):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            depth = found.a / (numbers.astype(np.float64) - found.b)
        depth[numbers == 0] = 0.0
        return depth


class _Compressed(NamedTuple):
    """A compressed depth image: its encoding, its quantisation, and its PNG."""

    encoding: str
    a: float
    b: float
    png: memoryview


def _open_compressed(message: Any) -> _Compressed:
    """Return what a CompressedImage with depth holds."""
    encoding, _, how = message.format.partition(";")
    encoding = encoding.strip()
    data = memoryview(message.data)
    if encoding not in ("16UC1", "32FC1") or "rvl" in how.lower():
        raise ValueError(
            f"format: expected depth (16UC1, 32FC1) compressed as PNG, got {message.format[:60]!r}"
        )
    if "compressedDepth" in how:
        if len(data) < _CODEC.size:
            raise ValueError(f"data: expected {_CODEC.size} bytes before the PNG, got {len(data)}")
        _, a, b = _CODEC.unpack_from(data)
        return _Compressed(encoding, a, b, data[_CODEC.size :])
    if encoding == "32FC1":
        raise ValueError(f"format: expected '32FC1; compressedDepth png', got {message.format[:60]!r}")
    return _Compressed(encoding, 0.0, 0.0, data)
