"""Where branches part, and where an end that lies on a strand stops."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from strand.reconstruction.harness.lines import Lines
from strand.reconstruction.harness.ports import Port, measure_angle
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_MAX_OVERHANG = 6.0  # length of the end beyond the strand that it lies on at most, half widths
_MAX_PARTING = np.radians(65.0)  # radians: angle of branches that part so slowly that the place moves
_PARTED = 1.08  # half widths of an arc where it is alone, its own
_MIN_SINE = 0.1  # of the angle between branches whose continuations meet somewhere
_MAX_BACK = 5.0  # distance of the place where they meet from the hub at most, half widths
_MIN_NARROWING = 0.02  # slope of the half width at least


def find_tip(port: Port, middle: Array, base: float | None, drawn: SurfaceMap) -> Array:
    """Return where a strand ends that lies on another one, or under it.

    On top it goes straight on while the surface is high over `base`, the other's height. Under it, where
    `base` is None, it goes on to the edge of the mask.
    """
    level = -np.inf if base is None else 0.5 * (port.near + base)
    # the hub lies beside the end's line, where the strands' middle lines meet
    along = -port.direction
    ahead = port.place + along * max(float((middle - port.place) @ along), 0.0)
    tip = ahead
    for steps in range(1, int(2.0 * _MAX_OVERHANG * port.half_width)):
        place = ahead + 0.5 * steps * along
        if not drawn.holds(place) or float(drawn.sample_heights(place[None])[0]) < level:
            break
        tip = place
    return tip


def find_parting(place: Array, own: Sequence[Port], lines: Lines, drawn: SurfaceMap) -> Array:
    """Return where two of three arcs part that leave side by side.

    A hub lies where the tubes come apart, beyond the place where their axes part. There their straight
    continuations meet, and the band's half width, led back along the third arc, is that of one of them.
    """
    if len(own) != 3:
        return place
    angles = {
        pair: measure_angle(own[pair[0]].mean_direction, own[pair[1]].mean_direction)
        for pair in combinations(range(3), 2)
    }
    pair, least = min(angles.items(), key=lambda found: found[1])
    met = _intersect(own[pair[0]], own[pair[1]], place)
    if least > _MAX_PARTING:
        return met
    trunk = own[3 - sum(pair)]
    cells = np.concatenate([place[None], lines.arcs[trunk.arc].from_end(trunk.end)])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(cells, axis=0), axis=1))])
    widths = drawn.sample_widths(cells)
    branch = 0.5 * (own[pair[0]].half_width + own[pair[1]].half_width)
    alone = widths < _PARTED * max(trunk.half_width, branch)
    count = int(alone.argmax()) if alone.any() else len(cells)
    count = min(count, len(cells) - 1)
    if count < 3:
        return met
    level, slope = np.polynomial.polynomial.polyfit(along[:count], widths[:count], 1)
    back = (min(branch, trunk.half_width) - level) / slope if slope < -_MIN_NARROWING else 0.0
    back = float(np.clip(back, 0.0, min(along[count - 1] + 2.5 * trunk.half_width, 0.6 * along[-1])))
    narrowed = np.array([np.interp(back, along, cells[:, axis]) for axis in (0, 1)])
    return np.asarray(0.5 * (met + narrowed))


def _intersect(some: Port, other: Port, place: Array) -> Array:
    """Return where the straight continuations of two arcs meet, or the hub if that is far from it."""
    sine = float(some.direction[0] * other.direction[1] - some.direction[1] * other.direction[0])
    way = other.place - some.place
    back = (
        (way[0] * other.direction[1] - way[1] * other.direction[0]) / sine if abs(sine) > _MIN_SINE else 0.0
    )
    met = some.place + back * some.direction
    near = np.linalg.norm(met - place) < _MAX_BACK * max(some.half_width, other.half_width)
    return np.asarray(met if near and abs(sine) > _MIN_SINE else place)
