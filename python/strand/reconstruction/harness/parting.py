"""Where branches part, and where an end that lies on a strand stops."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

import strand._core as _core
from strand.reconstruction.harness.lines import Lines
from strand.reconstruction.harness.ports import Port, measure_along, measure_angle
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_MAX_OVERHANG = 8.0  # length of the end beyond the strand that it lies on at most, half widths
_BENDS = np.linspace(-0.25, 0.25, 11)  # curvatures of an end that lies on a strand, in its half widths
_BESIDE = 1.2  # distance from the other strand's line where an end lies beside it, half widths
_MAX_PARTING = np.radians(65.0)  # radians: angle of branches that part so slowly that the place moves
_WIDEST = 6.0  # distance from the hub up to which the branches together are widest, half widths
_PARTED = 1.08  # half widths of an arc where it is alone, its own
_MIN_SINE = 0.1  # of the angle between branches whose continuations meet somewhere
_MAX_BACK = 5.0  # distance of the place where they meet from the hub at most, half widths
_MIN_NARROWING = 0.02  # slope of the half width at least


def find_tip(
    port: Port, middle: Array, other: Array, further: Array, base: float | None, drawn: SurfaceMap
) -> Array:
    """Return where a strand ends that lies on another one, or under it.

    On top it goes on, perhaps in an arc, while the surface is high over `base`, the height of the other,
    whose cells (M, 2) are `other`. Beside the other it goes on to the edge of the mask, or to cells (K, 2)
    of further strands. Under it, where `base` is None, it goes straight on so far.
    """
    level = -np.inf if base is None else 0.5 * (port.near + base)
    beside = (_BESIDE * float(np.median(drawn.sample_widths(other)))) ** 2
    # the hub lies beside the end's line, where the strands' middle lines meet
    along = -port.direction
    ahead = port.place + along * max(float((middle - port.place) @ along), 0.0)
    steps = 0.5 * np.arange(int(2.0 * _MAX_OVERHANG * port.half_width))
    side = np.array([-along[1], along[0]])
    found = []
    for bend in (0.0,) if base is None else _BENDS / port.half_width:
        # a parabola is near enough to an arc
        places = ahead + steps[:, None] * along + 0.5 * bend * steps[:, None] ** 2 * side
        heights = drawn.sample_heights(places)
        gone = ~drawn.hold(places) | ((heights < level) & (_measure_away(places, other) < beside))
        gone |= _measure_away(places, further) < beside
        count = max(int(np.argmax(np.append(gone[1:], True))), 1)
        found.append((count, float(heights[:count].mean()), places[count - 1]))
    longest = max(count for count, _, _ in found)
    likely = [one for one in found if one[0] >= longest - 2.0 * port.half_width]
    return np.asarray(max(likely, key=lambda one: one[1])[2])


def _measure_away(places: Array, cells: Array) -> Array:
    """Return the squared distance (M,) of each place (M, 2) from the nearest of some cells (K, 2)."""
    if not len(cells):
        return np.full(len(places), np.inf)
    flat = ((0, 0), (0, 1))
    return _core.find_squared_distances(np.pad(places, flat), np.pad(cells, flat))


def find_parting(place: Array, own: Sequence[Port], lines: Lines, drawn: SurfaceMap) -> Array:
    """Return where two of three arcs part that leave side by side.

    A hub lies where the tubes come apart, beyond the place where their axes part. There their straight
    continuations meet, and the band's half width, led back along the third arc, is that of one of them. Where
    they run side by side first, only the band tells.
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
    along = measure_along(cells)
    widths = drawn.sample_widths(cells)
    branch = 0.5 * (own[pair[0]].half_width + own[pair[1]].half_width)
    # the branches may run side by side, or apart, before they come together
    widest = int(widths[along < _WIDEST * trunk.half_width].argmax())
    alone = widths[widest:] < _PARTED * max(trunk.half_width, branch)
    count = widest + int(alone.argmax()) if alone.any() else len(cells)
    count = min(count, len(cells) - 1)
    if count - widest < 3:
        return met
    level, slope = np.polynomial.polynomial.polyfit(along[widest:count], widths[widest:count], 1)
    back = (min(branch, trunk.half_width) - level) / slope if slope < -_MIN_NARROWING else 0.0
    back = float(np.clip(back, 0.0, min(along[count - 1] + 2.5 * trunk.half_width, 0.6 * along[-1])))
    narrowed = np.array([np.interp(back, along, cells[:, axis]) for axis in (0, 1)])
    # branches that run side by side do not go straight on to where they part
    return np.asarray(narrowed if along[widest] > trunk.half_width else 0.5 * (met + narrowed))


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
