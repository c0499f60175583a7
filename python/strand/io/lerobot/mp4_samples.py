"""Count the samples that an MP4 file declares, since decoders make an index of them before they read any."""

from __future__ import annotations

import os
from pathlib import Path
from typing import BinaryIO

from strand.support.files import FileFormatError, open_file, read_at

_PARENTS = (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"moof", b"traf")  # boxes that hold boxes on the way
_COUNTS = {b"stsz": 8, b"stz2": 8, b"trun": 4}  # boxes of samples, and where each has their number
_MAX_BOXES = 100_000


def count_samples(path: Path) -> int:
    """Return the number of samples of all tracks; FileFormatError if the boxes do not fill the file."""
    with open_file(path) as file:
        try:
            return _count(file, os.fstat(file.fileno()).st_size)
        except ValueError as error:
            raise FileFormatError(path, f"truncated, or not an MP4 file ({error})") from error


def _count(file: BinaryIO, size: int) -> int:
    samples = boxes = 0
    stack = [(0, size)]
    while stack:
        at, end = stack.pop()
        if at == end:
            continue
        boxes += 1
        if boxes > _MAX_BOXES:
            raise ValueError(f"more than {_MAX_BOXES} boxes")
        if end - at < 8:
            raise ValueError("a box that is cut off")
        head = read_at(file, at, 8)
        length, kind, begun = int.from_bytes(head[:4], "big"), head[4:], at + 8
        if length == 1 and end - at >= 16:
            length, begun = int.from_bytes(read_at(file, begun, 8), "big"), at + 16
        length = length or end - at
        if not begun - at <= length <= end - at:
            raise ValueError("a box that ends outside of the file")
        stack.append((at + length, end))
        if kind in _PARENTS:
            stack.append((begun, at + length))
        elif kind in _COUNTS and length >= begun - at + _COUNTS[kind] + 4:
            samples += int.from_bytes(read_at(file, begun + _COUNTS[kind], 4), "big")
    return samples
