"""Pieces, holes and length of masks: nets and noise have more of them than ropes make."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import strand._core as _core

_MIN_PIECE = 3.0  # squares of the radius, pixels: smaller pieces are specks
_MIN_HOLE = 1.25  # squares of the radius, pixels: ragged masks have smaller holes without a crossing
_MIN_SQUARE = 1e-12  # squared pixels: thinner ropes are no ropes
_MAX_PIECES = 100  # pieces of a mask at most; more are no ropes
_MAX_HOLES = 100  # holes of a mask at most; more make a net or noise
_MAX_LENGTH = 10_000.0  # radii: longer ropes in one mask take long, and are no ropes


class MaskParts(NamedTuple):
    """The parts of a mask that are too large for raggedness.

    Attributes
    ----------
    largest : int
        Pixels of the largest piece.
    pieces, holes : int
    length : float
        The length of ropes as wide as twice their radius that fill the mask, radii.
    """

    largest: int
    pieces: int
    holes: int
    length: float


def count_mask_parts(mask: NDArray[np.bool_], radius: float) -> MaskParts:
    """Count the parts of a mask of ropes of a radius, pixels."""
    # squares of Python's numbers may overflow
    square = max(radius * radius, _MIN_SQUARE)
    largest, pieces, holes = _core.count_mask_parts(mask, _MIN_PIECE * square, _MIN_HOLE * square)
    return MaskParts(largest, pieces, holes, np.count_nonzero(mask) / (2.0 * square))


def explain_many_parts(parts: MaskParts) -> str | None:
    """Say why a mask with such parts shows no ropes; None if it may show some."""
    if parts.pieces > _MAX_PIECES:
        return f"a mask of {parts.pieces} pieces, where at most {_MAX_PIECES} may be ropes"
    if parts.holes > _MAX_HOLES:
        return (
            f"a mask of a net: it has {parts.holes} holes, and crossings of ropes make at most {_MAX_HOLES}"
        )
    if parts.length > _MAX_LENGTH:
        return f"a mask of {parts.length:.3g} radii of rope, where at most {_MAX_LENGTH:.0f} are read"
    return None
