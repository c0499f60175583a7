"""Choose the end at which a rope starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.ropes.chain import Chain
from strand.support.checks import Array

# a chain starts at the end farther back in this direction, which is oblique, as ropes often follow the axes
_START_DIRECTION = np.array([0.83, 0.47, 0.31])
_RING_DIRECTION = np.array([0.29, 0.17, 0.94])  # rings run anticlockwise seen from this direction
_MAX_DISTANCE = 0.1  # share of a chain's length: an earlier chain this near on average is the same rope
_PLACES = 25  # places along a chain that are compared with an earlier one


def rotate_ring(ring: Array) -> Array:
    """Return a ring's nodes, (K, 3) with the first repeated at the end, from where it lies farthest back."""
    first = int((ring @ _START_DIRECTION).argmin())
    return np.concatenate([ring[first:-1], ring[: first + 1]])


def oriented(chains: Sequence[Chain], previous: Sequence[Chain] = ()) -> list[Chain]:
    """Return chains that start where they started before, or at the end that a rule chooses.

    By the rule, open chains start at the end that lies farther back along a fixed direction. Closed chains
    start about where they lie farthest back, and run anticlockwise seen from another fixed direction.

    Parameters
    ----------
    chains : sequence of Chain
    previous : sequence of Chain
        Chains of an earlier model of the same ropes: a chain near one of them runs the same way.
    """
    turned = []
    for chain in chains:
        before = _find_earlier(chain, previous)
        backwards = _starts_late(chain) if before is None else _runs_against(chain, before)
        turned.append(chain.reversed() if backwards else chain)
    return turned


def _starts_late(chain: Chain) -> bool:
    points = chain.points
    if chain.closed:
        about = points - points.mean(axis=0)
        return bool(np.cross(about, np.roll(about, -1, axis=0)).sum(axis=0) @ _RING_DIRECTION < 0)
    return bool((points[0] - points[-1]) @ _START_DIRECTION > 0)


def _find_earlier(chain: Chain, previous: Sequence[Chain]) -> Chain | None:
    """Return the earlier chain of the same rope: the nearest, if it is near enough."""
    if not previous:
        return None
    best, least = None, _MAX_DISTANCE * chain.length
    places = chain.at(np.linspace(0.0, chain.length, _PLACES))
    for before in previous:
        if before.closed == chain.closed:
            distance = float(before.nearest(places).distance.mean())
            if distance < least:
                best, least = before, distance
    return best


def _runs_against(chain: Chain, before: Chain) -> bool:
    """Tell whether a chain runs against an earlier one."""
    places = np.linspace(0.0, chain.length, _PLACES)
    s = before.nearest(chain.at(places)).s
    steps = np.diff(s)
    if before.closed:
        # the shorter way around
        steps -= before.length * np.rint(steps / before.length)
    return bool(steps.sum() < 0)
