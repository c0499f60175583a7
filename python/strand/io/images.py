"""Images: depth from PNG and TIFF, masks from PNG, colours from PNG, JPEG, BMP and PPM."""

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

PNG_COLOURS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey and alpha", 6: "RGB and alpha"}
# of the many that Pillow knows, those that cameras write; some others start programs
COLOUR_FORMATS = ("PNG", "JPEG", "BMP", "PPM")
# tags of a TIFF: bits of each sample, what 0 means, samples of each pixel, kind of number; size of a tile
BITS, PHOTOMETRIC, SAMPLES, NUMBERS = 258, 262, 277, 339
TILE_WIDTH, TILE_HEIGHT = 322, 323
BLACK_IS_ZERO = 1
# none, LZW, deflate by two numbers, PackBits: the others lose something, or are for black and white
COMPRESSION, LOSSLESS = 259, (1, 5, 8, 32946, 32773)
TIFF_DEPTHS = {(16, 1): np.uint16, (32, 3): np.float32}


def read_depth_png(path: Path, budget: Budget) -> NDArray[Any]:
    """(H, W) uint16 of a single-channel 16-bit PNG."""
    return decode_depth_png(path, budget.read(path), budget)


def decode_depth_png(file: str | Path, data: bytes, budget: Budget) -> NDArray[Any]:
    """(H, W) uint16 of the bytes of a single-channel 16-bit PNG; errors name the file."""
    return _single_channel(file, data, budget, (16,), "16-bit single-channel depth PNG").astype(np.uint16)


def read_depth_tiff(path: Path, budget: Budget) -> NDArray[Any]:
    """(H, W) uint16 or float32 of a TIFF with one image of one channel."""
    data = budget.read(path)

    def depth(image: Any) -> NDArray[Any]:
        # a tile is decoded as a whole, however little of the image it holds
        tile = image.tag_v2.get(TILE_WIDTH, 1) * image.tag_v2.get(TILE_HEIGHT, 1)
        budget.take(path, 8 * tile)
        return _depth_of_tiff(path, image)

    return _decoded(path, budget, data, ("TIFF",), "TIFF file", 8, depth)


def _depth_of_tiff(path: Path, image: Any) -> NDArray[Any]:
    """Pixels of an opened TIFF, which must be a depth image and the only one."""
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
    """(H, W) Labels of a single-channel PNG of 1, 8 or 16 bits, 0 for no rope."""
    data = budget.read(path)
    return _single_channel(path, data, budget, (1, 8, 16), "single-channel mask PNG of 1, 8 or 16 bits")


def read_color(path: Path, budget: Budget) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 of a colour image."""
    data = budget.read(path)
    expected = f"colour image ({', '.join(COLOUR_FORMATS)})"
    return _decoded(path, budget, data, COLOUR_FORMATS, expected, 3, lambda image: image.convert("RGB"))


def _single_channel(
    path: str | Path, data: bytes, budget: Budget, depths: tuple[int, ...], expected: str
) -> NDArray[Any]:
    """(H, W) of a grey PNG with one of some numbers of bits for each pixel."""
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 26:
        raise FileFormatError(path, "truncated, or not a PNG file")
    # Pillow shortens some 16-bit images to 8 bits without saying so, hence the look at the header
    width, height, bits, colour = struct.unpack(">IIBB", data[16:26])
    if bits not in depths or colour != 0:
        kind = PNG_COLOURS.get(colour, "unknown")
        raise FileFormatError(path, f"expected a {expected}, got {bits}-bit {kind}")
    image = _decoded(path, budget, data, ("PNG",), "PNG", 8, np.asarray)
    if image.shape != (height, width):
        raise FileFormatError(
            path, f"truncated or damaged PNG: expected {(height, width)} pixels, got {image.shape}"
        )
    return image


def _decoded(
    path: str | Path,
    budget: Budget,
    data: bytes,
    formats: tuple[str, ...],
    expected: str,
    pixel_bytes: int,
    pixels: Callable[[Any], Any],
) -> NDArray[Any]:
    """Return what `pixels` makes of an opened image, whose size is asked before it is decoded."""
    pillow = import_extra("PIL.Image")
    # Pillow's limit on the pixels of an image holds; what it warns of from there on is refused
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
            return np.asarray(pixels(image))
    except (FileFormatError, MemoryError):
        raise
    except Exception as error:  # Pillow has an error of its own kind for every way to be damaged
        raise FileFormatError(path, f"truncated, or not a {expected} ({error})") from error
