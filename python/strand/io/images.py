"""Read images: depth from PNG and TIFF, masks from PNG, colours from PNG, JPEG, BMP and PPM."""

from __future__ import annotations

import struct
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.image_parts import PNG, keep_pixels
from strand.io.tiff_tags import (
    BITS,
    COMPRESSION,
    NUMBERS,
    PHOTOMETRIC,
    SAMPLES,
    TILE_HEIGHT,
    TILE_WIDTH,
    read_tags,
)
from strand.support.extras import import_extra
from strand.support.files import FileFormatError

# names of PNG's colour types
PNG_COLORS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey and alpha", 6: "RGB and alpha"}
# the formats that cameras write; for some others, Pillow starts programs
COLOR_FORMATS = ("PNG", "JPEG", "BMP", "PPM")
WIDE_MODES = ("I", "F")  # how the names of Pillow's grey images of more than 8 bits begin
# values of a TIFF file's tags
BLACK_IS_ZERO = 1  # value of PHOTOMETRIC
LOSSLESS = (1, 5, 8, 32946, 32773)  # values of COMPRESSION: none, LZW, deflate (two numbers), PackBits
TIFF_DEPTHS = {(16, 1): np.uint16, (32, 3): np.float32}  # type by BITS and NUMBERS


Shape = tuple[int, ...] | None  # height and width that an image must have; None: any
_DECODING = 20  # bytes of a pixel while Pillow decodes it: coefficients, channels, and copies of these
_PIECE = 512  # bytes of a strip or tile of a TIFF while Pillow decodes it
_ROWS = 64  # rows that are converted at once


def read_depth_png(path: Path, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) uint16 pixels of a single-channel 16-bit PNG file."""
    return decode_depth_png(path, budget.read(path), budget)


def decode_depth_png(file: str | Path, data: bytes, budget: Budget, shape: Shape = None) -> NDArray[Any]:
    """Return the (H, W) uint16 pixels of a single-channel 16-bit PNG in memory; errors name `file`.

    An image of another size than `shape` is not decoded.
    """
    expected = "16-bit single-channel depth PNG"
    return _read_single_channel(file, data, budget, (16,), expected, shape, None).astype(np.uint16)


def read_depth_tiff(path: Path, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) uint16 or float32 pixels of a TIFF file with one image of one channel."""
    return decode_depth_tiff(path, budget.read(path), budget)


def decode_depth_tiff(file: str | Path, data: bytes, budget: Budget, shape: Shape = None) -> NDArray[Any]:
    """Return the (H, W) uint16 or float32 pixels of a TIFF in memory; errors name `file`.

    An image of another size than `shape` is not decoded.
    """
    with budget.hold(file, len(data)):
        try:
            tags = read_tags(data)
        except ValueError as error:
            raise FileFormatError(file, f"truncated, or not a TIFF file ({error})") from error
        kind = _find_tiff_type(file, tags.numbers)
        if not tags.alone:
            raise FileFormatError(file, "expected a TIFF of one image, got several")
        # Pillow decodes whole tiles, which may be larger than the image
        tile = tags.numbers.get(TILE_WIDTH, 1) * tags.numbers.get(TILE_HEIGHT, 1)
        with budget.hold(file, 8 * tile + _PIECE * tags.pieces):
            size = np.dtype(kind).itemsize
            return _decode(file, budget, tags.data, ("TIFF",), "TIFF file", size, shape).astype(kind)


def _find_tiff_type(path: str | Path, numbers: dict[int, int]) -> type[Any]:
    """Return the type of a TIFF's pixels; refuse anything but a depth image."""
    bits, samples, number = numbers.get(BITS, 1), numbers.get(SAMPLES, 1), numbers.get(NUMBERS, 1)
    kind = TIFF_DEPTHS.get((bits, number))
    if samples != 1 or kind is None or numbers.get(PHOTOMETRIC) != BLACK_IS_ZERO:
        reason = (
            "expected a TIFF of one channel of 16-bit whole numbers or 32-bit floats where 0 is black, "
            f"got {samples} of {bits} bits of kind {number}, photometric {numbers.get(PHOTOMETRIC)}"
        )
        raise FileFormatError(path, reason)
    if numbers.get(COMPRESSION, 1) not in LOSSLESS:
        reason = (
            f"expected a TIFF without compression, or LZW, deflate or PackBits, got {numbers[COMPRESSION]}"
        )
        raise FileFormatError(path, reason)
    return kind


def read_mask_png(path: Path, budget: Budget, shape: Shape, key: str) -> NDArray[Any]:
    """Return the (H, W) labels of a single-channel PNG of 1, 8 or 16 bits; 0 means no rope.

    An image of another size than `shape` is not decoded; errors name `key`.
    """
    expected = "single-channel mask PNG of 1, 8 or 16 bits"
    return _read_single_channel(path, budget.read(path), budget, (1, 8, 16), expected, shape, key)


def read_color(path: Path, budget: Budget, shape: Shape = None) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 pixels of a colour image.

    An image of another size than `shape` is not decoded.
    """
    return decode_color(path, budget.read(path), budget, shape)


def decode_color(file: str | Path, data: bytes, budget: Budget, shape: Shape = None) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 pixels of a colour image in memory; errors name `file`."""
    expected = f"colour image ({', '.join(COLOR_FORMATS)})"

    def read_pixels(image: Any) -> NDArray[np.uint8]:
        if image.mode.startswith(WIDE_MODES):
            raise FileFormatError(
                file,
                "expected a colour image of 8 bits per channel, got grey of more than 8 bits, such as depth",
            )
        return _convert_to_colors(image)

    return _decode(file, budget, data, COLOR_FORMATS, expected, 3, shape, "color", read_pixels)


def _convert_to_colors(image: Any) -> NDArray[np.uint8]:
    """Return the (H, W, 3) colours of an image, some rows at a time to save memory."""
    width, height = image.size
    pixels = np.empty((height, width, 3), dtype=np.uint8)
    for top in range(0, height, _ROWS):
        part = image.crop((0, top, width, min(top + _ROWS, height)))
        pixels[top : top + _ROWS] = np.asarray(part.convert("RGB"))
    return pixels


def _read_single_channel(
    path: str | Path,
    data: bytes,
    budget: Budget,
    depths: tuple[int, ...],
    expected: str,
    shape: Shape,
    key: str | None,
) -> NDArray[Any]:
    """Return the (H, W) pixels of a grey PNG with an accepted number of bits for each pixel."""
    if data[:8] != PNG or data[12:16] != b"IHDR" or len(data) < 26:
        raise FileFormatError(path, "truncated, or not a PNG file")
    # check the header, as Pillow silently reduces some 16-bit images to 8 bits
    width, height, bits, color = struct.unpack(">IIBB", data[16:26])
    if bits not in depths or color != 0:
        kind = PNG_COLORS.get(color, "unknown")
        raise FileFormatError(path, f"expected a {expected}, got {bits}-bit {kind}")
    image = _decode(path, budget, data, ("PNG",), "PNG", 2, shape, key)
    if image.shape != (height, width):
        raise FileFormatError(
            path, f"truncated or damaged PNG: expected {(height, width)} pixels, got {image.shape}"
        )
    return image


def _decode(
    path: str | Path,
    budget: Budget,
    data: bytes,
    formats: tuple[str, ...],
    expected: str,
    pixel_bytes: int,
    shape: Shape = None,
    place: str | None = None,
    read_pixels: Callable[[Any], NDArray[Any]] = np.asarray,
) -> NDArray[Any]:
    """Return the pixels of an image, which `read_pixels` takes from Pillow's, once all its sizes fit."""
    pillow = import_extra("PIL.Image")
    # Pillow only warns above its limit; strand refuses
    most = pillow.MAX_IMAGE_PIXELS
    try:
        with budget.hold(path, len(data)), pillow.open(BytesIO(keep_pixels(data)), formats=formats) as image:
            width, height = image.size
            if shape not in (None, (height, width)):
                reason = f"expected the depth image's shape {shape}, got {(height, width)}"
                raise FileFormatError(path, reason, place)
            if most is not None and width * height > most:
                raise FileFormatError(path, f"{width} x {height} pixels, more than Pillow's limit of {most}")
            budget.take(path, width * height * pixel_bytes)
            with budget.hold(path, width * height * _DECODING):
                return read_pixels(image)
    except (FileFormatError, MemoryError):
        raise
    except pillow.UnidentifiedImageError:  # its message is an address in memory
        raise FileFormatError(path, f"truncated, or not a {expected}") from None
    except Exception as error:  # Pillow raises errors of many types for damaged files
        raise FileFormatError(path, f"truncated, or not a {expected} ({error})") from error
