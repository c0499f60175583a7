"""Pieces and holes of masks: nets and noise have more of them than ropes make."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import strand._core as _core

_MIN_PIECE = 3.0  # squares of the radius, pixels: smaller pieces are specks
_MIN_HOLE = 1.25  # squares of the radius, pixels: ragged masks have smaller holes without a crossing
_MAX_PIECES = 100  # pieces of a mask at most; more are no ropes
_MAX_HOLES = 100  # holes of a mask at most; more make a net or noise


def count_mask_parts(mask: NDArray[np.bool_], radius: float) -> tuple[int, int, int]:
    """Return the pixels of a mask's largest piece, and the numbers of its larger pieces and holes.

    `radius` is that of the ropes, pixels.
    """
    return _core.count_mask_parts(mask, _MIN_PIECE * radius**2, _MIN_HOLE * radius**2)


def explain_many_parts(pieces: int, holes: int) -> str | None:
    """Say why a mask with so many pieces and holes shows no ropes; None if it may show some."""
    if pieces > _MAX_PIECES:
        return f"a mask of {pieces} pieces, where at most {_MAX_PIECES} may be ropes"
    if holes > _MAX_HOLES:
        return f"a mask of a net: it has {holes} holes, where crossings of ropes make at most {_MAX_HOLES}"
    return None
