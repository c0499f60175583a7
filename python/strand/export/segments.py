"""Ropes cut into segments of one length, as simulators of rods take them."""

from __future__ import annotations

import numpy as np

from strand.geometry.line import Line
from strand.support.checks import Array, check_positive

# radii: shorter ones would touch the neighbours of their neighbours
SPACING = 3.0
_MOST = 100_000


def cut_segments(chain: Line, spacing: float | None, least: float = 0.0, fewest: int = 2) -> Array:
    """(N + 1, 3) Places on the centreline, from end to end, where N segments meet; of a ring (N, 3).

    Parameters
    ----------
    chain : Line
    spacing : float or None
        How long segments are along the rope, metres; they are as long or longer, but for ropes that are too
        short for the fewest. None: three radii.
    least : float
        Radii that `spacing` must have at least.
    fewest : int
        How many segments an open rope has at least; a ring has three.

    Raises
    ------
    TypeError
        If `spacing` is not a number.
    ValueError
        If it is too small.
    """
    step = SPACING * chain.radius if spacing is None else check_positive("spacing", spacing)
    if step < least * chain.radius:
        raise ValueError(
            f"spacing: expected at least {least:g} radii, {least * chain.radius:g} m, got {spacing}"
        )
    if chain.length / step > _MOST:
        raise ValueError(f"spacing: expected at most {_MOST} segments of a rope, got {spacing}")
    count = max(int(chain.length / step), 3 if chain.closed else fewest)
    return chain.at(np.linspace(0.0, chain.length, count + 1)[: count if chain.closed else None])
