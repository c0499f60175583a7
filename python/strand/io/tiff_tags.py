"""Keep the tags of a TIFF file that describe its pixels, and bound what they declare.

Pillow copies the data of every tag, which may all lie in one place. So only these tags reach it.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

# tags of a TIFF file
WIDTH = 256  # pixels
HEIGHT = 257  # pixels
BITS = 258  # bits of each sample
COMPRESSION = 259  # method of compression
PHOTOMETRIC = 262  # meaning of 0
SAMPLES = 277  # samples of each pixel
NUMBERS = 339  # kind of number
TILE_WIDTH = 322  # pixels
TILE_HEIGHT = 323  # pixels
_FILL_ORDER = 266  # order of bits
_ORIENTATION = 274  # where the first row and column are
_ROWS = 278  # rows of a strip
_PLANES = 284  # order of samples
_PREDICTOR = 317  # differences before compression
_STARTS = (273, 324)  # places of strips or tiles
_SIZES = (279, 325)  # bytes of strips or tiles
_NUMBERS = (WIDTH, HEIGHT, BITS, COMPRESSION, PHOTOMETRIC, SAMPLES, NUMBERS, TILE_WIDTH, TILE_HEIGHT)
_KEPT = frozenset({*_NUMBERS, _FILL_ORDER, _ORIENTATION, _ROWS, _PLANES, _PREDICTOR, *_STARTS, *_SIZES})
_MAX_SAMPLES = 16  # numbers of a tag, one for each sample
_KINDS = {3: "u2", 4: "u4", 16: "u8"}  # NumPy's type of the numbers of a tag
_BIG = (b"II+\0\x08\0\0\0", b"MM\0+\0\x08\0\0")  # how a TIFF of 64-bit places begins
_SMALL = (b"II*\0", b"MM\0*")  # how a TIFF of 32-bit places begins


@dataclass(frozen=True)
class Tags:
    """The first image of a TIFF file.

    Attributes
    ----------
    data : bytes
        The file with the tags of pixels alone.
    numbers : dict of int to int
        The first number of each tag but those of strips and tiles.
    pieces : int
        Number of strips or tiles.
    alone : bool
        Whether there is no other image.
    """

    data: bytes
    numbers: dict[int, int]
    pieces: int
    alone: bool


def read_tags(data: bytes) -> Tags:
    """Return the tags of pixels of a TIFF file; ValueError says what is wrong.

    All strips or tiles together may not have more bytes than the file.
    """
    big = data.startswith(_BIG)
    if not (big or data.startswith(_SMALL)) or len(data) < 16:
        raise ValueError("no header of a TIFF")
    order = "<" if data[0] == ord("I") else ">"
    # a place, the number of tags, and a tag with the number of its numbers
    place, number, entry = [
        struct.Struct(order + kind) for kind in (("Q", "Q", "HHQ") if big else ("I", "H", "HHI"))
    ]
    (start,) = place.unpack_from(data, 8 if big else 4)
    if start + number.size > len(data):
        raise ValueError("the tags lie behind the end")
    (count,) = number.unpack_from(data, start)
    width = entry.size + place.size
    end = start + number.size + width * count
    if end + place.size > len(data):
        raise ValueError("the tags end too late")
    kept: dict[int, bytes] = {}
    numbers, pieces = {}, 0
    for at in range(start + number.size, end, width):
        tag, kind, length = entry.unpack_from(data, at)
        if tag not in _KEPT:
            continue
        if tag in kept or kind not in _KINDS or not length:
            raise ValueError(f"tag {tag}: expected once, and whole numbers of 16, 32 or 64 bits")
        kept[tag] = data[at : at + width]
        values = _read_numbers(data, at + entry.size, place, np.dtype(order + _KINDS[kind]), length)
        if tag in _SIZES and values.sum(dtype=np.float64) > len(data):
            raise ValueError("strips or tiles have more bytes than the file")
        if tag in (*_STARTS, *_SIZES):
            pieces = max(pieces, length)
        elif length <= _MAX_SAMPLES:
            numbers[tag] = int(values[0])
        else:
            raise ValueError(f"tag {tag}: expected up to {_MAX_SAMPLES} numbers, got {length}")
    table = number.pack(len(kept)) + b"".join(kept.values()) + bytes(place.size)
    (following,) = place.unpack_from(data, end)
    return Tags(
        b"".join([data[:start], table, data[start + len(table) :]]), numbers, pieces, following in (0, start)
    )


def _read_numbers(
    data: bytes, at: int, place: struct.Struct, kind: np.dtype[Any], length: int
) -> NDArray[Any]:
    """Return the numbers of a tag: at `at` if there is room, else at the place given there."""
    if length * kind.itemsize > place.size:
        (at,) = place.unpack_from(data, at)
    if at + length * kind.itemsize > len(data):
        raise ValueError("the numbers of a tag lie behind the end")
    return np.frombuffer(data, kind, length, at)
