"""Readers of single files: depth images, points, colours."""

from __future__ import annotations

import re
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.files import FileFormatError, extra

PNG_COLOURS = {0: "grey", 2: "RGB", 3: "palette", 4: "grey and alpha", 6: "RGB and alpha"}
PLY_VERTICES = re.compile(rb"^element\s+vertex\s+(\d+)\s*$", re.MULTILINE)


def content(path: Path) -> bytes:
    """Return what a file holds, which must be something."""
    data = path.read_bytes()
    if not data:
        raise FileFormatError(f"{path}: the file is empty")
    return data


def read_png(path: Path, data: bytes) -> NDArray[Any]:
    """(H, W) uint16 of a single-channel 16-bit PNG."""
    return _single_channel_png(path, data, (16,), "16-bit single-channel depth PNG").astype(np.uint16)


def read_mask(path: Path, data: bytes) -> NDArray[Any]:
    """(H, W) Labels, 0 for no rope, of a single-channel PNG of 1, 8 or 16 bits, or of an NPY file."""
    if path.suffix.lower() == ".npy":
        return _npy(path, data)
    return _single_channel_png(path, data, (1, 8, 16), "single-channel mask PNG of 1, 8 or 16 bits")


def _single_channel_png(path: Path, data: bytes, depths: tuple[int, ...], expected: str) -> NDArray[Any]:
    """(H, W) of a grey PNG with one of some numbers of bits for each pixel."""
    pillow = extra("PIL.Image")
    if data[:8] != b"\x89PNG\r\n\x1a\n" or data[12:16] != b"IHDR" or len(data) < 26:
        raise FileFormatError(f"{path}: truncated, or not a PNG file")
    # Pillow shortens some 16-bit images to 8 bits without saying so, hence the look at the header
    bits, colour = data[24], data[25]
    if bits not in depths or colour != 0:
        kind = PNG_COLOURS.get(colour, "unknown")
        raise FileFormatError(f"{path}: expected a {expected}, got {bits}-bit {kind}")
    try:
        with pillow.open(BytesIO(data), formats=["PNG"]) as image:
            image.verify()
        with pillow.open(BytesIO(data), formats=["PNG"]) as image:
            return np.asarray(image)
    except Exception as error:  # Pillow has an error of its own kind for every way to be damaged
        raise FileFormatError(f"{path}: truncated or damaged PNG ({error})") from error


def read_color(path: Path, data: bytes) -> NDArray[np.uint8]:
    """(H, W, 3) uint8 of a colour image in any format that Pillow reads."""
    pillow = extra("PIL.Image")
    try:
        with pillow.open(BytesIO(data)) as image:
            return np.asarray(image.convert("RGB"), dtype=np.uint8)
    except Exception as error:  # Pillow has an error of its own kind for every way to be damaged
        raise FileFormatError(f"{path}: truncated, or not a colour image ({error})") from error


def read_npy(path: Path, data: bytes) -> NDArray[Any]:
    """(H, W) uint16, or (H, W) or (N, 3) of floats."""
    array = _npy(path, data)
    if array.ndim != 2 or not (array.dtype.kind == "f" or array.dtype == np.uint16):
        raise FileFormatError(
            f"{path}: expected a depth image (H, W) of floats or uint16, or points (N, 3) of floats, "
            f"got {array.shape} {array.dtype}"
        )
    return array


def _npy(path: Path, data: bytes) -> NDArray[Any]:
    try:
        return np.lib.format.read_array(BytesIO(data), allow_pickle=False)
    except (ValueError, EOFError, OSError, MemoryError) as error:
        raise FileFormatError(f"{path}: truncated, or not an .npy file ({error})") from error


def read_ply(path: Path, data: bytes) -> NDArray[Any]:
    """(N, 3) of floats, the vertices of a PLY file."""
    ply = extra("trimesh.exchange.ply")
    end = data.find(b"end_header")
    count = PLY_VERTICES.search(data[:end].replace(b"\r\n", b"\n")) if end >= 0 else None
    if count is None:
        raise FileFormatError(f"{path}: truncated, or not a PLY file with vertices")
    if int(count[1]) == 0:
        return np.empty((0, 3))
    try:
        vertices = ply.load_ply(BytesIO(data), fix_texture=False, skip_materials=True)["vertices"]
    except Exception as error:  # the reader has an error of its own kind for every way to be damaged
        raise FileFormatError(f"{path}: truncated or damaged PLY ({error})") from error
    # of an ASCII file that ends too early the reader returns what there is, with ragged rows as objects
    if vertices.shape != (int(count[1]), 3) or vertices.dtype == object:
        raise FileFormatError(f"{path}: truncated, fewer than {int(count[1])} whole vertices")
    if vertices.dtype.kind != "f":
        raise FileFormatError(f"{path}: expected vertices with float or double x, y and z")
    return np.asarray(vertices)
