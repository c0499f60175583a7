"""Images: depth and masks from PNG, colours from PNG, JPEG, BMP and PPM."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.files import FileFormatError, extra
from strand.io.budget import Budget

PNG_COLOURS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey and alpha", 6: "RGB and alpha"}
# of the many that Pillow knows, those that cameras write; some others start programs
COLOUR_FORMATS = ("PNG", "JPEG", "BMP", "PPM")


def read_depth_png(path: Path, budget: Budget) -> NDArray[Any]:
    """(H, W) uint16 of a single-channel 16-bit PNG."""
    return decode_depth_png(path, budget.read(path), budget)


def decode_depth_png(file: str | Path, data: bytes, budget: Budget) -> NDArray[Any]:
    """(H, W) uint16 of the bytes of a single-channel 16-bit PNG; errors name the file."""
    return _single_channel(file, data, budget, (16,), "16-bit single-channel depth PNG").astype(np.uint16)


def read_mask_png(path: Path, budget: Budget) -> NDArray[Any]:
    """(H, W) Labels of a single-channel PNG of 1, 8 or 16 bits, 0 for no rope."""
    data = budget.read(path)
    return _single_channel(path, data, budget, (1, 8, 16), "single-channel mask PNG of 1, 8 or 16 bits")


def read_color(path: Path, budget: Budget) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 of a colour image."""
    data = budget.read(path)
    colours = _decoded(
        path, budget, data, COLOUR_FORMATS, f"colour image ({', '.join(COLOUR_FORMATS)})", "RGB"
    )
    return np.asarray(colours, dtype=np.uint8)


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
    image = _decoded(path, budget, data, ("PNG",), "PNG", None)
    if image.shape != (height, width):
        raise FileFormatError(
            path, f"truncated or damaged PNG: expected {(height, width)} pixels, got {image.shape}"
        )
    return image


def _decoded(
    path: str | Path, budget: Budget, data: bytes, formats: tuple[str, ...], expected: str, mode: str | None
) -> NDArray[Any]:
    """Pixels of an image, in a mode of Pillow's or as they are; its size is asked before they are decoded."""
    pillow = extra("PIL.Image")
    # Pillow's limit on the pixels of an image holds; what it warns of from there on is refused
    most = pillow.MAX_IMAGE_PIXELS
    try:
        with pillow.open(BytesIO(data), formats=formats) as image:
            width, height = image.size
            budget.take(path, width * height * (3 if mode else 8))
            if most is not None and width * height > most:
                raise FileFormatError(path, f"{width} x {height} pixels, more than Pillow's limit of {most}")
            if image.format == "PNG":
                with pillow.open(BytesIO(data), formats=formats) as other:
                    other.verify()
            return np.asarray(image.convert(mode) if mode else image)
    except (FileFormatError, MemoryError):
        raise
    except Exception as error:  # Pillow has an error of its own kind for every way to be damaged
        raise FileFormatError(path, f"truncated, or not a {expected} ({error})") from error
