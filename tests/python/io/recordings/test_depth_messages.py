"""Tests of depth images in messages, in every encoding and with faults."""

from __future__ import annotations

import struct
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from lib.bag_files import Messages
from strand.io.budget import Budget
from strand.io.recordings.depth_messages import decode_compressed_image, decode_image, is_depth

MADE = Messages()
DEPTH = np.random.default_rng(0).integers(0, 60_000, size=(5, 7)).astype(np.uint16)
METRES = DEPTH.astype(np.float32) / 1000


def decode_compressed(message, max_bytes=1 << 24):
    return decode_compressed_image(message, Budget(max_bytes))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("image", [DEPTH, METRES], ids=["16UC1", "32FC1"])
def test_images_in_either_order_of_bytes(image, order):
    message = MADE.image(image.astype(image.dtype.newbyteorder(order)), 0)
    found = decode_image(message)
    np.testing.assert_array_equal(found, image)
    assert found.dtype == image.dtype
    assert is_depth(message)


@pytest.mark.parametrize("cut", [0, 6], ids=["whole", "last row without padding"])
def test_rows_may_be_padded(cut):
    rows = np.zeros((5, 10), dtype=np.uint16)
    rows[:, :7] = DEPTH
    data = np.frombuffer(rows.tobytes(), np.uint8)
    message = MADE.image(DEPTH, 0, step=20, data=data[: len(data) - cut])
    np.testing.assert_array_equal(decode_image(message), DEPTH)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"encoding": "rgb8"}, "encoding: expected depth .16UC1, mono16, 32FC1., got 'rgb8'"),
        ({"encoding": "32FC1"}, "data: 7 x 5 pixels of 32FC1 with rows of 14 bytes do not fit in 70 bytes"),
        ({"width": 0}, "width, height: expected pixels, got 0 x 5"),
        ({"height": 0}, "width, height: expected pixels, got 7 x 0"),
        ({"height": 2**32 - 1, "width": 2**32 - 1}, "do not fit in 70 bytes"),
        ({"height": 6}, "do not fit in 70 bytes"),
        ({"step": 2**31}, "do not fit in 70 bytes"),
        ({"step": 0}, "do not fit in 70 bytes"),
        ({"data": np.empty(0, np.uint8)}, "do not fit in 0 bytes"),
    ],
)
def test_images_of_inconsistent_sizes_are_refused(changes, reason):
    with pytest.raises(ValueError, match=reason):
        decode_image(MADE.image(DEPTH, 0, **changes))


def test_compressed_depth_of_whole_numbers():
    message = MADE.compressed(DEPTH, 0)
    np.testing.assert_array_equal(decode_compressed(message), DEPTH)
    assert is_depth(message)
    plain = SimpleNamespace(format="16UC1; png compressed ", data=message.data[12:])
    np.testing.assert_array_equal(decode_compressed(plain), DEPTH)


def test_compressed_depth_of_floats_is_quantised():
    # numbers of compressed_depth_image_transport with depth_max 10 m and depth_quantization 100
    a, most = 100.0 * 101.0, 10.0
    b = 1.0 - a / most
    metres = np.random.default_rng(1).uniform(0.3, 9.0, size=(6, 8))
    metres[0, 0] = 0.0
    with np.errstate(divide="ignore"):
        numbers = np.where(metres > 0, a / metres + b, 0).astype(np.uint16)
    found = decode_compressed(MADE.compressed(numbers, 0, kind="32FC1", a=a, b=b))
    assert found[0, 0] == 0
    np.testing.assert_allclose(found.ravel()[1:], metres.ravel()[1:], rtol=0, atol=metres.max() ** 2 / a)
    assert np.abs(found - metres).max() > 0


@pytest.mark.parametrize(
    ("kind", "data", "reason"),
    [
        ("rgb8; jpeg compressed bgr8", b"", "format: expected depth .* as PNG, got 'rgb8; jpeg"),
        ("16UC1; compressedDepth rvl", bytes(50), "compressed as PNG, got '16UC1; compressedDepth rvl'"),
        ("32FC1; png compressed", bytes(50), "expected '32FC1; compressedDepth png'"),
        ("16UC1; compressedDepth", bytes(11), "expected 12 bytes before the PNG, got 11"),
        ("16UC1; compressedDepth", bytes(12), "truncated, or not a PNG"),
        ("16UC1; compressedDepth", bytes(200), "truncated, or not a PNG"),
    ],
)
def test_other_compressed_images_are_refused(kind, data, reason):
    message = SimpleNamespace(format=kind, data=data)
    with pytest.raises(ValueError, match=reason):
        decode_compressed(message)


def test_damaged_and_oversized_pictures_are_refused():
    whole = bytes(MADE.compressed(DEPTH, 0).data)
    for part in range(13, len(whole) - 20, 7):
        with pytest.raises(ValueError, match="truncated"):
            decode_compressed(SimpleNamespace(format="16UC1; compressedDepth", data=whole[:part]))
    header = b"IHDR" + struct.pack(">II", 9_000, 9_000) + whole[36:41]
    huge = whole[:24] + header + struct.pack(">I", zlib.crc32(header)) + whole[45:]
    with pytest.raises(ValueError, match="max_bytes"):
        decode_compressed(SimpleNamespace(format="16UC1; compressedDepth", data=huge), 1 << 20)
    assert not is_depth(SimpleNamespace(format="jpeg"))
