"""Read a camera's pinhole matrix from a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from strand.support.checks import Array, check_intrinsics
from strand.support.files import FileFormatError, read_bytes, read_json

MAX_BYTES = 1 << 16  # largest file, bytes

# JSON keys of the principal point; RealSense writes the second pair
_CENTERS = (("cx", "cy"), ("ppx", "ppy"))


def read_intrinsics(path: str | os.PathLike[str]) -> Array:
    """Return the (3, 3) pinhole matrix of a file, pixels.

    A `.json` file has the keys `fx`, `fy`, `cx` and `cy` (or `ppx` and `ppy`), or an `intrinsic_matrix` of
    nine numbers by columns, as Open3D writes it. Any other file is text with nine numbers by rows.
    """
    json = Path(path).suffix.lower() == ".json"
    try:
        if json:
            return check_intrinsics("intrinsics", _parse_json(read_json(path, MAX_BYTES)))
        return check_intrinsics("intrinsics", _reshape(read_bytes(path, MAX_BYTES).split()))
    except FileFormatError:  # says what is wrong already
        raise
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        wanted = "fx, fy, cx and cy, or an intrinsic_matrix" if json else "a matrix"
        reason = f"expected the numbers of a pinhole camera: {wanted} of nine numbers ({error})"
        raise FileFormatError(path, reason) from error


def _parse_json(content: Any) -> Array:
    if "intrinsic_matrix" in content:
        return _reshape(content["intrinsic_matrix"]).T
    for center in _CENTERS:
        if all(name in content for name in center):
            fx, fy, cx, cy = (float(content[name]) for name in ("fx", "fy", *center))
            return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    raise ValueError(f"got {', '.join(map(repr, content)) or 'nothing'}"[:200])


def _reshape(content: Any) -> Array:
    numbers = [float(one) for one in content]
    if len(numbers) != 9:
        raise ValueError(f"got {len(numbers)}")
    return np.reshape(numbers, (3, 3))
