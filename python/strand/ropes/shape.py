"""Distance of a rope from a target shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strand.geometry.line import Line
from strand.support.checks import Array

_PLACES = 200  # along the rope that are compared


@dataclass(frozen=True, eq=False)
class ShapeError:
    """A rope compared with its target, at equal fractions of both lengths.

    Attributes
    ----------
    rms, worst : float
        Root mean square and greatest of the distances, metres.
    s : float
        Arc length of the worst place on the rope, metres.
    longer : float
        Length of the rope minus that of the target, metres.
    reversed : bool
        Whether the rope runs against its target.
    arc_lengths : (200,) ndarray
        The compared places on the rope, metres.
    offsets : (200, 3) ndarray
        From these to their targets, world frame, metres.
    """

    rms: float
    worst: float
    s: float
    longer: float
    reversed: bool
    arc_lengths: Array
    offsets: Array


def compare_shapes(chain: Line, target: Line) -> ShapeError:
    """Compare a rope with its target, see `Chain.shape_error`."""
    share = np.linspace(0.0, 1.0, _PLACES, endpoint=not chain.closed)
    arcs = share * chain.length
    places, wanted = chain.at(arcs), target.at(share * target.length)
    ways = [(False, wanted), (True, wanted[::-1])]
    if chain.closed:
        # rings may start anywhere
        ways = [(back, np.roll(way, k, axis=0)) for back, way in ways for k in range(_PLACES)]
    back, best = min(ways, key=lambda way: float(((way[1] - places) ** 2).sum()))
    offsets = best - places
    away = np.linalg.norm(offsets, axis=1)
    return ShapeError(
        rms=float(np.sqrt((away**2).mean())),
        worst=float(away.max()),
        s=float(arcs[away.argmax()]),
        longer=chain.length - target.length,
        reversed=back,
        arc_lengths=arcs,
        offsets=offsets,
    )
