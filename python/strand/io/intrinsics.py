"""A camera's pinhole matrix from a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from strand.support.checks import Array, check_intrinsics
from strand.support.files import FileFormatError, read_bytes, read_json

MOST_BYTES = 1 << 16


# what JSON calls the principal point beside the focal lengths fx and fy: most programs, and RealSense's
_CENTRES = (("cx", "cy"), ("ppx", "ppy"))


def read_intrinsics(path: str | os.PathLike[str]) -> Array:
    """Read a pinhole matrix.

    Parameters
    ----------
    path : str or path-like
        A `.json` file with `fx`, `fy`, `cx` and `cy` (or `ppx` and `ppy`), or with an `intrinsic_matrix` of
        nine numbers, column by column, as Open3D writes it; any other is text, the matrix row by row.

    Returns
    -------
    (3, 3) ndarray
        Pixels.

    Raises
    ------
    strand.FileFormatError
        If it holds no pinhole matrix.
    OSError
        If it cannot be read.
    """
    json = Path(path).suffix.lower() == ".json"
    try:
        if json:
            return check_intrinsics("intrinsics", _of_json(read_json(path, MOST_BYTES)))
        return check_intrinsics("intrinsics", _nine(read_bytes(path, MOST_BYTES).split()))
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        wanted = "fx, fy, cx and cy, or an intrinsic_matrix" if json else "a matrix"
        reason = f"expected the numbers of a pinhole camera: {wanted} of nine numbers ({error})"
        raise FileFormatError(path, reason) from error


def _of_json(content: Any) -> Array:
    if "intrinsic_matrix" in content:
        return _nine(content["intrinsic_matrix"]).T
    for centre in _CENTRES:
        if all(name in content for name in centre):
            fx, fy, cx, cy = (float(content[name]) for name in ("fx", "fy", *centre))
            return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    raise ValueError(f"got {', '.join(map(repr, content)) or 'nothing'}"[:200])


def _nine(content: Any) -> Array:
    numbers = [float(one) for one in content]
    if len(numbers) != 9:
        raise ValueError(f"got {len(numbers)}")
    return np.reshape(numbers, (3, 3))
