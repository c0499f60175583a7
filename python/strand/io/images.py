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
from strand.support.extras import import_extra
from strand.support.files import FileFormatError

# names of PNG's colour types
PNG_COLORS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey and alpha", 6: "RGB and alpha"}
# the formats that cameras write; for some others, Pillow starts programs
COLOR_FORMATS = ("PNG", "JPEG", "BMP", "PPM")
WIDE_MODES = ("I", "F")  # how the names of Pillow's grey images of more than 8 bits begin
# tags of a TIFF file, and their values
BITS = 258  # tag: bits of each sample
COMPRESSION = 259  # tag: method of compression
PHOTOMETRIC = 262  # tag: meaning of 0
SAMPLES = 277  # tag: samples of each pixel
TILE_WIDTH = 322  # tag: width of a tile, pixels
TILE_HEIGHT = 323  # tag: height of a tile, pixels
NUMBERS = 339  # tag: kind of number
BLACK_IS_ZERO = 1  # value of PHOTOMETRIC
LOSSLESS = (1, 5, 8, 32946, 32773)  # values of COMPRESSION: none, LZW, deflate (two numbers), PackBits
TIFF_DEPTHS = {(16, 1): np.uint16, (32, 3): np.float32}  # type by BITS and NUMBERS


def read_depth_png(path: Path, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) uint16 pixels of a single-channel 16-bit PNG file."""
    return decode_depth_png(path, budget.read(path), budget)


def decode_depth_png(file: str | Path, data: bytes, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) uint16 pixels of a single-channel 16-bit PNG in memory; errors name `file`."""
    return _read_single_channel(file, data, budget, (16,), "16-bit single-channel depth PNG").astype(
        np.uint16
    )


def read_depth_tiff(path: Path, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) uint16 or float32 pixels of a TIFF file with one image of one channel."""
    data = budget.read(path)

    def read_pixels(image: Any) -> NDArray[Any]:
        # Pillow decodes whole tiles, which may be larger than the image
        tile = image.tag_v2.get(TILE_WIDTH, 1) * image.tag_v2.get(TILE_HEIGHT, 1)
        budget.take(path, 8 * tile)
        return _read_tiff_pixels(path, image)

    return _decode(path, budget, data, ("TIFF",), "TIFF file", 8, read_pixels)


def _read_tiff_pixels(path: Path, image: Any) -> NDArray[Any]:
    """Return the pixels of an open TIFF file; refuse anything but a single depth image."""
    tags = image.tag_v2
    bits, samples, numbers = tags.get(BITS, (1,))[0], tags.get(SAMPLES, 1), tags.get(NUMBERS, (1,))[0]
    kind = TIFF_DEPTHS.get((bits, numbers))
    if samples != 1 or kind is None or tags.get(PHOTOMETRIC) != BLACK_IS_ZERO:
        reason = (
            "expected a TIFF of one channel of 16-bit whole numbers or 32-bit floats where 0 is black, "
            f"got {samples} of {bits} bits of kind {numbers}, photometric {tags.get(PHOTOMETRIC)}"
        )
        raise FileFormatError(path, reason)
    if tags.get(COMPRESSION, 1) not in LOSSLESS:
        reason = (
            f"expected a TIFF without compression, or LZW, deflate or PackBits, got {tags.get(COMPRESSION)}"
        )
        raise FileFormatError(path, reason)
    pixels = np.asarray(image)
    try:
        image.seek(1)
    except EOFError:
        return pixels.astype(kind)
    raise FileFormatError(path, "expected a TIFF of one image, got several")


def read_mask_png(path: Path, budget: Budget) -> NDArray[Any]:
    """Return the (H, W) labels of a single-channel PNG of 1, 8 or 16 bits; 0 means no rope."""
    data = budget.read(path)
    return _read_single_channel(path, data, budget, (1, 8, 16), "single-channel mask PNG of 1, 8 or 16 bits")


def read_color(path: Path, budget: Budget) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 pixels of a colour image."""
    return decode_color(path, budget.read(path), budget)


def decode_color(file: str | Path, data: bytes, budget: Budget) -> NDArray[np.uint8]:
    """Return the (H, W, 3) uint8 pixels of a colour image in memory; errors name `file`."""
    expected = f"colour image ({', '.join(COLOR_FORMATS)})"

    def read_pixels(image: Any) -> Any:
        if image.mode.startswith(WIDE_MODES):
            raise FileFormatError(
                file,
                "expected a colour image of 8 bits per channel, got grey of more than 8 bits, such as depth",
            )
        return image.convert("RGB")

    return _decode(file, budget, data, COLOR_FORMATS, expected, 3, read_pixels)


def _read_single_channel(
    path: str | Path, data: bytes, budget: Budget, depths: tuple[int, ...], expected: str
) -> NDArray[Any]:
    """Return the (H, W) pixels of a grey PNG with an accepted number of bits for each pixel."""
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 26:
        raise FileFormatError(path, "truncated, or not a PNG file")
    # check the header, as Pillow silently reduces some 16-bit images to 8 bits
    width, height, bits, color = struct.unpack(">IIBB", data[16:26])
    if bits not in depths or color != 0:
        kind = PNG_COLORS.get(color, "unknown")
        raise FileFormatError(path, f"expected a {expected}, got {bits}-bit {kind}")
    image = _decode(path, budget, data, ("PNG",), "PNG", 8, np.asarray)
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
    read_pixels: Callable[[Any], Any],
) -> NDArray[Any]:
    """Open an image, check its size, and return the pixels that `read_pixels` decodes."""
    pillow = import_extra("PIL.Image")
    # Pillow only warns above its limit; strand refuses
    most = pillow.MAX_IMAGE_PIXELS
    try:
        with pillow.open(BytesIO(data), formats=formats) as image:
            width, height = image.size
            budget.take(path, width * height * pixel_bytes)
            if most is not None and width * height > most:
                raise FileFormatError(path, f"{width} x {height} pixels, more than Pillow's limit of {most}")
            if image.format == "PNG":
                with pillow.open(BytesIO(data), formats=formats) as other:
                    other.verify()
            return np.asarray(read_pixels(image))
    except (FileFormatError, MemoryError):
        raise
    except pillow.UnidentifiedImageError:  # its message is an address in memory
        raise FileFormatError(path, f"truncated, or not a {expected}") from None
    except Exception as error:  # Pillow raises errors of many types for damaged files
        raise FileFormatError(path, f"truncated, or not a {expected} ({error})") from error
