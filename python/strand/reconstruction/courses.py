"""Courses: which places chains run through, in which order, and whether two answers agree on that."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.geometry.polyline import path_length
from strand.support.checks import Array

Chains = list[tuple[Array, bool]]
"""(K, 3) ordered nodes of each chain, metres, and whether it is closed: its last node is then its first."""

Course = tuple[Array, float, bool]
"""(33, 3) places evenly along a chain, its length, metres, and whether it is closed."""

_SHARES = np.linspace(0.0, 1.0, 33)  # of a chain's length: places that are compared
_MAX_OFFSET = 4.0  # radii: places farther from each other, and lengths that differ more, are not the same


def sample_courses(chains: Chains) -> list[Course]:
    """Return the course of each chain."""
    found = []
    for nodes, closed in chains:
        s = path_length(nodes)
        at = _SHARES * s[-1]
        places = np.stack([np.interp(at, s, nodes[:, k]) for k in range(3)], axis=1)
        found.append((places, float(s[-1]), closed))
    return found


def are_same_courses(
    some: Sequence[Course], others: Sequence[Course], radius: float, max_offset: float = _MAX_OFFSET
) -> bool:
    """Tell whether two sets of courses pair up, in either direction of each, within `max_offset` radii."""
    if len(some) != len(others):
        return False
    left = list(others)
    for places, length, closed in some:
        for k, (theirs, their_length, their_closed) in enumerate(left):
            if closed != their_closed or abs(length - their_length) >= max_offset * radius:
                continue
            limit = (max_offset * radius) ** 2
            if any((((places - way) ** 2).sum(axis=1) < limit).all() for way in (theirs, theirs[::-1])):
                del left[k]
                break
        else:
            return False
    return True


def have_same_courses(some: Chains, others: Chains, radius: float) -> bool:
    """Tell whether two sets of chains run through the same places in the same order."""
    return are_same_courses(sample_courses(some), sample_courses(others), radius)
