"""A camera's pinhole matrix from a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from strand.checks import Array, pinhole
from strand.files import FileFormatError, read_bytes, read_json

MOST_BYTES = 1 << 16


def read_intrinsics(path: str | os.PathLike[str]) -> Array:
    """Read a pinhole matrix.

    Parameters
    ----------
    path : str or path-like
        A `.json` file with an `intrinsic_matrix` of nine numbers, column by column, as Open3D writes it; any
        other is text, the matrix row by row.

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
    content: Any = read_json(path, MOST_BYTES) if json else read_bytes(path, MOST_BYTES).split()
    try:
        if json:
            content = content["intrinsic_matrix"]
        numbers = [float(one) for one in content]
        if len(numbers) != 9:
            raise ValueError(f"got {len(numbers)}")
        matrix = np.reshape(numbers, (3, 3))
        return pinhole("intrinsics", matrix.T if json else matrix)
    except (KeyError, OverflowError, TypeError, ValueError) as error:
        reason = f"expected the nine numbers of a pinhole matrix ({error})"
        raise FileFormatError(path, reason) from error
