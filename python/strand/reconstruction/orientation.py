"""Which end of a rope is its start."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.ropes.chain import Chain
from strand.support.checks import Array

# the end that lies farther back along this direction is the start: askew to the axes, so that ropes laid
# along them are not a tie
_FORWARD = np.array([0.83, 0.47, 0.31])
# rings run anticlockwise seen from there: above, but not for upright ones
_ABOVE = np.array([0.29, 0.17, 0.94])


def started(ring: Array) -> Array:
    """Return a ring's nodes, (K, 3) with the first again at the end, from where it lies farthest back."""
    first = int((ring @ _FORWARD).argmin())
    return np.concatenate([ring[first:-1], ring[: first + 1]])


def oriented(chains: Sequence[Chain], previous: Sequence[Chain] = ()) -> list[Chain]:
    """Turn chains so that they start at the end that a rule names, or where they started before.

    Parameters
    ----------
    chains : sequence of Chain
    previous : sequence of Chain
        Chains of an earlier model of the same ropes: a chain near one of them runs the same way.

    Returns
    -------
    list of Chain
        In the same order. Open ones start at the end that lies farther back along a fixed direction askew
        to the world's axes; closed ones start about where they lie farthest back, and run anticlockwise
        seen from above.
    """
    turned = []
    for chain in chains:
        before = _same(chain, previous)
        backwards = _starts_late(chain) if before is None else _against(chain, before)
        turned.append(chain.reversed() if backwards else chain)
    return turned


def _starts_late(chain: Chain) -> bool:
    points = chain.points
    if chain.closed:
        about = points - points.mean(axis=0)
        return bool(np.cross(about, np.roll(about, -1, axis=0)).sum(axis=0) @ _ABOVE < 0)
    return bool((points[0] - points[-1]) @ _FORWARD > 0)


def _same(chain: Chain, previous: Sequence[Chain]) -> Chain | None:
    """Return the earlier chain that lies nearest, on average within 10 % of the chain's length."""
    best, least = None, 0.1 * chain.length
    places = chain.at(np.linspace(0.0, chain.length, 25))
    for before in previous:
        if before.closed == chain.closed:
            apart = float(before.nearest(places).distance.mean())
            if apart < least:
                best, least = before, apart
    return best


def _against(chain: Chain, before: Chain) -> bool:
    """Tell whether a chain runs against an earlier one."""
    places = np.linspace(0.0, chain.length, 25)
    s = before.nearest(chain.at(places)).s
    steps = np.diff(s)
    if before.closed:
        # the shorter way round
        steps -= before.length * np.rint(steps / before.length)
    return bool(steps.sum() < 0)
