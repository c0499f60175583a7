"""Ends that run into the side of another chain: a branched object is no rope."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.reconstruction.evidence.visibility import Visibility
from strand.ropes.chain import Chain
from strand.support.checks import Array

# a branch ends at most so far from the side of what it comes from, which is how far counting may miss an end,
# and points at its axis this well; the way between is looked at in such steps; in radii
_MEETS, _STRAIGHT, _LOOK = 1.75, 1.2, 0.25


def branches(chains: Sequence[Chain], visibility: Visibility | None = None) -> list[tuple[int, int, Array]]:
    """Find ends that run straight into the side of another chain, as no rope does that only touches it.

    Parameters
    ----------
    chains : sequence of Chain
    visibility : Visibility, optional
        What the views saw: an end is no branch if they saw through between it and the other chain.

    Returns
    -------
    list of (int, int, (3,) ndarray)
        Number of the chain that ends, of the one it ends on, and where, metres.
    """
    found = []
    for number, chain in enumerate(chains):
        for points in () if chain.closed else (chain.points, chain.points[::-1]):
            r = chain.radius
            out = points[0] - points[min(8, len(points) - 1)]
            out = out / np.linalg.norm(out)
            for other, strand in enumerate(chains):
                if other == number:
                    continue
                meets = strand.radius + _MEETS * r
                ahead = points[0] + np.arange(0.0, meets, _LOOK * r)[:, None] * out
                apart = np.linalg.norm(ahead[:, None] - strand.points[None], axis=2)
                place = int(apart.min(axis=0).argmin())
                inner = 2.0 * r < strand.arc_length[place] < strand.length - 2.0 * r or strand.closed
                if not inner or apart[0].min() >= meets or apart.min() >= _STRAIGHT * r:
                    continue
                nearest = apart.min(axis=1)
                between = ahead[: nearest.argmin()][nearest[: nearest.argmin()] > strand.radius]
                if visibility is None or not visibility.free(between, r).any():
                    found.append((number, other, strand.points[place]))
    return found
