"""Decide for each place where arcs meet: a junction, a crossing, or an end that lies on a strand.

Height counts most: at a crossing one strand lies on the other, at a junction all have one height. Then come
straight continuation and equal widths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strand.reconstruction.harness.lines import NO_HUB, Lines, measure_length
from strand.reconstruction.harness.ports import Port, measure_angle, measure_port
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

End = tuple[int, int]
"""An arc's number, and 0 for its first or 1 for its last cell."""

_PAIRINGS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))
_BEND = 0.45  # radians: bend of a strand through a crossing that costs 1
_SIDE = 0.6  # radians: the same, between a strand and the way to its continuation
_WIDTH = 0.46  # relative difference of its widths that costs 1
_RISE = 0.8  # height of the upper strand over the lower one at least, radii
_LEVEL = 0.25  # difference of heights at a junction at most, radii
_RISE_SD = 0.35  # radii: deviation of these
_RISE_WEIGHT = 2.0  # of a missing rise at a crossing
_LEVEL_WEIGHT = 4.0  # of a rise at a junction
_MAX_LEVEL = 8.0  # of that at most
_JUNCTION = 2.5  # cost of a junction of four
_UNLIKE = 0.3  # share of a junction's unexplained heights that lessens its margin
_MAX_MIDDLE = 12.0  # length of the stretch that two crossing strands share at most, half widths
_TOP = 75.0  # percentile of the heights in the middle that tells how high the upper strand lies
_MAX_TORN = 3.0  # distance of the hubs of one junction, half widths
_LAID_RISE = 0.8  # height of the end over the strand at least, radii
_LAID_DROP = 0.45  # height of the end over its own rest at least, radii
_MAX_OVERHANG = 6.0  # length of the end beyond the strand that it lies on at most, half widths
_MAX_PARTING = np.radians(65.0)  # radians: angle of branches that part so slowly that the place moves
_PARTED = 1.08  # half widths of an arc where it is alone, its own
_MIN_SINE = 0.1  # of the angle between branches whose continuations meet somewhere
_MAX_BACK = 5.0  # distance of the place where they meet from the hub at most, half widths
_MIN_NARROWING = 0.02  # slope of the half width at least


@dataclass(frozen=True, eq=False)
class Junction:
    """A place where arcs are joined.

    Attributes
    ----------
    place : (2,) ndarray
        Row and column.
    ends : list of End
        The arcs' ends that meet there.
    margin : float
        Cost of the next best interpretation over this one's.
    """

    place: Array
    ends: list[End]
    margin: float


@dataclass(frozen=True, eq=False)
class Passing:
    """Two ends of arcs that are one strand, which crosses another.

    Attributes
    ----------
    ends : (End, End)
    height : float
        Of the strand's surface at the crossing, metres.
    other : float or None
        Of the other strand's surface there; None if the other is an end.
    middle : (2,) ndarray
        Row and column of the crossing.
    margin : float
        Cost of the next best interpretation over this one's.
    """

    ends: tuple[End, End]
    height: float
    other: float | None
    middle: Array
    margin: float


@dataclass(frozen=True, eq=False)
class LaidEnd:
    """A free end that lies on another strand: it goes on to a place."""

    end: End
    place: Array


@dataclass(frozen=True, eq=False)
class Decisions:
    """What each place is.

    Attributes
    ----------
    junctions : list of Junction
    passings : list of Passing
    laid : list of LaidEnd
    inner : set of int
        Numbers of arcs inside crossings and junctions, which are no edges.
    """

    junctions: list[Junction]
    passings: list[Passing]
    laid: list[LaidEnd]
    inner: set[int]


def decide_places(lines: Lines, drawn: SurfaceMap, on_table: bool) -> Decisions:
    """Decide what each place where arcs meet is.

    Parameters
    ----------
    lines : Lines
    drawn : SurfaceMap
    on_table : bool
        Whether ropes lie on a table, so that a crossing rises above its surroundings.
    """
    ends = [lines.list_ends(hub) for hub in range(len(lines.hubs))]
    ports = {end: measure_port(*end, lines, drawn) for at in ends for end in at}
    passings, inner, done, refused = _find_crossings(lines, drawn, ends, ports, on_table)
    groups = _group_torn(lines, drawn, inner, done)
    junctions, laid = [], []
    for members in groups:
        at = [end for hub in members for end in ends[hub] if end[0] not in inner]
        middle = lines.hubs[members].mean(axis=0)
        own = [ports[end] for end in at]
        found = _find_laid(own, drawn, on_table)
        if found is not None and found[2] < 0.0:
            top, below, cost, _ = found
            first, second = (own[number] for number in below)
            base = 0.5 * (first.rest + second.rest)
            laid.append(LaidEnd((own[top].arc, own[top].end), _find_tip(own[top], middle, base, drawn)))
            passings.append(
                Passing(((first.arc, first.end), (second.arc, second.end)), base, None, middle, -cost)
            )
            continue
        place = _find_parting(middle, own, lines, drawn)
        others = [refused[hub] for hub in members if hub in refused]
        others += [] if found is None else [found[2]]
        margin = min([_LEVEL_WEIGHT, *others]) - (0.0 if found is None else _UNLIKE * found[3])
        junctions.append(Junction(place, at, margin))
    return Decisions(junctions, passings, laid, inner)


def _find_crossings(
    lines: Lines, drawn: SurfaceMap, ends: list[list[End]], ports: dict[End, Port], on_table: bool
) -> tuple[list[Passing], set[int], set[int], dict[int, float]]:
    """Return crossings at hubs of four arcs, and at two hubs of three that share a short one.

    The surest comes first. Also return the arcs inside, the hubs of crossings, and for each other hub by
    how much a crossing would cost more.
    """
    candidates: list[tuple[tuple[int, ...], int | None, list[Port], Array]] = []
    for hub, at in enumerate(ends):
        if len(at) == 4:
            candidates.append(((hub,), None, [ports[end] for end in at], lines.hubs[hub : hub + 1]))
    for number, arc in enumerate(lines.arcs):
        first, second = arc.hubs
        if NO_HUB in arc.hubs or first == second or len(ends[first]) != 3 or len(ends[second]) != 3:
            continue
        width = float(drawn.sample_widths(lines.hubs[[first, second]]).mean())
        if measure_length(arc.cells) > _MAX_MIDDLE * width:
            continue
        own = [ports[end] for hub in (first, second) for end in ends[hub] if end[0] != number]
        if len(own) == 4:
            candidates.append(((first, second), number, own, arc.cells))
    priced = [
        (*_price_crossing(own, middle, drawn, on_table), hubs, shared, own, middle)
        for hubs, shared, own, middle in candidates
    ]
    passings: list[Passing] = []
    inner: set[int] = set()
    done: set[int] = set()
    for cost, pairs, heights, hubs, shared, own, middle in sorted(priced, key=lambda found: found[0]):
        if cost >= 0.0 or done.intersection(hubs) or (shared is not None and pairs == _PAIRINGS[0]):
            continue
        for pair, height, other in zip(pairs, heights, heights[::-1], strict=True):
            some, rest = (own[number] for number in pair)
            both = ((some.arc, some.end), (rest.arc, rest.end))
            passings.append(Passing(both, height, other, middle.mean(axis=0), -cost))
        done.update(hubs)
        if shared is not None:
            inner.add(shared)
    refused: dict[int, float] = {}
    for cost, _, _, hubs, *_ in priced:
        for hub in set(hubs) - done:
            refused[hub] = min(max(cost, 0.0), refused.get(hub, np.inf))
    return passings, inner, done, refused


def _price_crossing(
    own: Sequence[Port], middle: Array, drawn: SurfaceMap, on_table: bool
) -> tuple[float, tuple[tuple[int, int], tuple[int, int]], tuple[float, float]]:
    """Return the cost of a crossing of four ports less a junction's, the pairs, and the pairs' heights."""
    radius = drawn.cell * float(np.mean([port.half_width for port in own]))
    top = float(np.percentile(drawn.sample_heights(middle), _TOP))
    rest = max(port.rest for port in own)
    deviation = _measure_deviation(own, radius)
    best = None
    for pairs in _PAIRINGS:
        bends = sum(_price_continuation(own[i], own[j]) for i, j in pairs)
        first, second = (0.5 * (own[i].height + own[j].height) for i, j in pairs)
        # axes, as strands of different widths that lie on a table differ in their surfaces
        widths = [0.5 * drawn.cell * (own[i].half_width + own[j].half_width) for i, j in pairs]
        rise = abs(first - widths[0] - second + widths[1])
        if on_table:
            rise = max(rise, top - rest)
        crossing = bends + _RISE_WEIGHT * (max(0.0, _RISE * radius - rise) / deviation) ** 2
        level = _LEVEL_WEIGHT * (max(0.0, rise - _LEVEL * radius) / deviation) ** 2
        # an end that lies on a strand makes a rise too
        junction = _JUNCTION + min(level, _MAX_LEVEL)
        if best is None or crossing < best[0]:
            best = (crossing, junction, pairs, (first, second))
    assert best is not None
    crossing, junction, pairs, heights = best
    return crossing - junction, pairs, heights


def _price_continuation(some: Port, other: Port) -> float:
    """Return the cost of two ports that are one strand: bend, sideways shift, difference of widths."""
    bend = measure_angle(-some.direction, other.direction)
    way = other.place - some.place
    way = way / max(float(np.linalg.norm(way)), 1e-9)
    side = measure_angle(-some.direction, way) + measure_angle(other.direction, way)
    widths = (some.half_width - other.half_width) / (0.5 * (some.half_width + other.half_width))
    return float((bend / _BEND) ** 2 + (side / _SIDE) ** 2 + (widths / _WIDTH) ** 2)


def _group_torn(lines: Lines, drawn: SurfaceMap, inner: set[int], done: set[int]) -> list[list[int]]:
    """Return groups of hubs that are one junction, which thinning took apart; add their arcs to `inner`."""
    group = list(range(len(lines.hubs)))
    for number, arc in enumerate(lines.arcs):
        first, second = arc.hubs
        if NO_HUB in arc.hubs or first == second or number in inner or done.intersection(arc.hubs):
            continue
        if measure_length(arc.cells) < _MAX_TORN * float(
            drawn.sample_widths(lines.hubs[[first, second]]).max()
        ):
            inner.add(number)
            old, new = group[second], group[first]
            group = [new if own == old else own for own in group]
    return [
        [hub for hub in range(len(lines.hubs)) if group[hub] == number and hub not in done]
        for number in sorted({group[hub] for hub in range(len(lines.hubs)) if hub not in done})
    ]


def _measure_deviation(own: Sequence[Port], radius: float) -> float:
    """Return the standard deviation of a difference of heights, metres: of noise, and of strands' waves."""
    return float(np.hypot(_RISE_SD * radius, np.mean([port.scatter for port in own])))


def _find_laid(
    own: Sequence[Port], drawn: SurfaceMap, on_table: bool
) -> tuple[int, tuple[int, int], float, float] | None:
    """Return which of three ports may be an end that lies on the other two's strand, and its cost.

    The cost is that of such an end less that of a junction. The last number says how much a junction fails to
    explain the ports' heights.
    """
    if len(own) != 3 or not on_table:
        return None
    best, unlike = None, 0.0
    for top in range(3):
        below = (0, 1) if top == 2 else (0, 2) if top == 1 else (1, 2)
        some, other = own[below[0]], own[below[1]]
        radius = drawn.cell * own[top].half_width
        deviation = _measure_deviation(own, radius)
        bend = measure_angle(-some.mean_direction, other.mean_direction)
        widths = (some.half_width - other.half_width) / (0.5 * (some.half_width + other.half_width))
        rise = own[top].near - max(some.rest, other.rest)
        drop = own[top].near - own[top].rest
        low = max(0.0, _LAID_RISE * radius - rise) ** 2 + max(0.0, _LAID_DROP * radius - drop) ** 2
        laid = (bend / _BEND) ** 2 + (widths / _WIDTH) ** 2 + _RISE_WEIGHT * low / deviation**2
        level = min(rise, drop) - _LEVEL * radius
        junction = _JUNCTION + _LEVEL_WEIGHT * (max(0.0, level) / deviation) ** 2
        unlike = max(unlike, junction - _JUNCTION)
        if best is None or laid - junction < best[2]:
            best = (top, below, laid - junction)
    assert best is not None
    return (*best, unlike)


def _find_tip(port: Port, middle: Array, base: float, drawn: SurfaceMap) -> Array:
    """Return where a strand ends that lies on another one: it goes straight on while the surface is high."""
    level = 0.5 * (port.near + base)
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


def _find_parting(place: Array, own: Sequence[Port], lines: Lines, drawn: SurfaceMap) -> Array:
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
