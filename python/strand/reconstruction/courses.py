"""Courses: which places chains run through, in which order, and whether two answers agree on that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.geometry.polyline import path_length
from strand.support.checks import Array
from strand.support.lazy import lazy_property

Chains = list[tuple[Array, bool]]
"""(K, 3) ordered nodes of each chain, metres, and whether it is closed: its last node is then its first."""

_SHARES = np.linspace(0.0, 1.0, 33)  # of a chain's length: places that are compared
_MAX_OFFSET = 4.0  # radii: places farther from each other, and lengths that differ more, are not the same


@dataclass(frozen=True, eq=False)
class Course:
    """How a chain runs.

    Attributes
    ----------
    nodes : (K, 3) ndarray
        In order, metres.
    closed : bool
        Whether the last node is the first.
    """

    nodes: Array
    closed: bool

    @lazy_property
    def places(self) -> Array:
        """(33, 3) Places evenly along the chain, metres."""
        at = _SHARES * self.length
        return np.stack([np.interp(at, self._arc_length, self.nodes[:, k]) for k in range(3)], axis=1)

    @property
    def length(self) -> float:
        """Metres."""
        return float(self._arc_length[-1])

    @lazy_property
    def _arc_length(self) -> Array:
        return path_length(self.nodes)


def are_same_courses(
    some: Sequence[Course], others: Sequence[Course], radius: float, max_offset: float = _MAX_OFFSET
) -> bool:
    """Tell whether two sets of courses pair up, in either direction of each, within `max_offset` radii."""
    if len(some) != len(others):
        return False
    left = list(others)
    for one in some:
        for k, other in enumerate(left):
            if one.closed != other.closed or abs(one.length - other.length) >= max_offset * radius:
                continue
            limit = (max_offset * radius) ** 2
            ways = (other.places, other.places[::-1])
            if any((((one.places - way) ** 2).sum(axis=1) < limit).all() for way in ways):
                del left[k]
                break
        else:
            return False
    return True


def have_same_courses(some: Chains, others: Chains, radius: float) -> bool:
    """Tell whether two sets of chains run through the same places in the same order."""
    mine, theirs = ([Course(nodes, closed) for nodes, closed in chains] for chains in (some, others))
    return are_same_courses(mine, theirs, radius)
