"""Ways to read a place where arcs meet, and what each costs.

A place is a junction, a crossing, an end that lies on a strand, or a strand that passes over a junction.
Height counts most: at a crossing one strand lies on the other, at a junction all have one height. Then come
straight continuation and equal widths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from strand.reconstruction.harness.ports import Port, measure_angle
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_PAIRINGS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))
_BEND = 0.45  # radians: bend of a strand through a crossing that costs 1
_MAX_BENT = 3.5  # length of a crossing that a strand passes bent as outside at most, sums of half widths
_MAX_TURN = 0.6  # radians: turn of a strand from its port to the middle of a crossing at most
_SIDE = 0.6  # radians: the same, between a strand and the way to its continuation
_WIDTH = 0.46  # relative difference of its widths that costs 1
_RISE = 0.8  # height of the upper strand over the lower one at least, radii
_LEVEL = 0.25  # difference of heights at a junction at most, radii
_RISE_SD = 0.35  # radii: deviation of these
_LONG = 4.0  # length of a stretch that two strands share that tells whether there is room, half widths
_NARROW = 25.0  # percentile of the room along it that counts
_ROOM = 0.5  # by which it is wider or higher than one strand at least, radii
_ROOM_SD = 0.2  # radii: deviation of it
_TOUCH = 0.7  # distance of the axes of strands that touch at most, sums of their widths
_VALLEY = 0.5  # depth of the valley between them at least, radii
_LOWEST = 15.0  # percentile of the heights between them that tells how deep it is
_RISE_WEIGHT = 2.0  # of a missing rise at a crossing
_LEVEL_WEIGHT = 4.0  # of a rise at a junction
_MAX_LEVEL = 8.0  # of that at most
_MAX_UNLIKE = 12.0  # the same at a junction of three
_BRANCH = 1.25  # cost of each arc of a junction but two
_TORN = 2.5  # cost that close hubs save that are one junction
_MISS = 0.4  # squared distances of arcs' lines from one place that cost nothing, half widths
_MAX_MISS = 3.0  # cost of arcs that point at places far apart
_FURTHER = 2.0  # cost of each hub of one place but two
_SPREAD = 0.6  # difference of heights at a junction that a strand passes at most, radii
_TOP = 75.0  # percentile of the heights in the middle that tells how high the upper strand lies
_LAID = -0.75  # cost of an end that lies on a strand, beside what it leaves unexplained
_LAID_RISE = 0.8  # height of the end over the strand at least, radii
_LAID_DROP = 0.45  # height of the end over its own rest at least, radii


@dataclass(frozen=True, eq=False)
class Reading:
    """A reading of a place. Numbers are those of its ports.

    Attributes
    ----------
    cost : float
    junction : tuple of int
        The ports that are joined; empty if none are.
    pairs : tuple of (int, int)
        The ports that are one strand, which passes.
    heights : tuple of float
        The height of each such strand's surface, metres.
    others : tuple of (float or None)
        That of what it crosses; None if that is an end.
    laid : int or None
        The port of an end that lies on the strand, or under it.
    under : bool
        Whether it lies under it.
    unlike : float
        How much a junction there fails to explain the heights.
    place : (2,) ndarray or None
        Row and column of a junction that a strand passes, or a tie tells.
    tied : bool
        Whether a tie tells it.
    """

    cost: float
    junction: tuple[int, ...] = ()
    pairs: tuple[tuple[int, int], ...] = ()
    heights: tuple[float, ...] = ()
    others: tuple[float | None, ...] = ()
    laid: int | None = None
    under: bool = False
    unlike: float = 0.0
    place: Array | None = None
    tied: bool = False


def list_readings(
    own: Sequence[Port],
    hubs: Sequence[int],
    middle: Array,
    drawn: SurfaceMap,
    on_table: bool,
    torn: bool,
    tie: Array | None,
) -> list[Reading]:
    """Return the ways to read a place, the cheapest first.

    Parameters
    ----------
    own : sequence of Port
    hubs : sequence of int
        The hub of each port; a place may have several.
    middle : (M, 2) ndarray
        Cells between the ports.
    drawn : SurfaceMap
    on_table : bool
        Whether ropes lie on a table, so that a crossing rises above its surroundings.
    torn : bool
        Whether the hubs are so close that they may be one junction.
    tie : (2,) ndarray or None
        Row and column of a tie between two hubs that holds two strands together.
    """
    count = len(set(hubs))
    one = count == 1
    torn = torn or tie is not None
    readings: list[Reading] = []
    if len(own) == 3 and (one or torn):
        readings = _read_three(own, drawn, on_table)
    elif len(own) == 4:
        readings = _read_four(own, hubs, middle, drawn, on_table, one or torn, tie is not None)
    elif len(own) == 5:
        readings = _read_five(own, hubs, middle, drawn, on_table, one or torn)
    if (one or torn) and len(own) not in (3, 4, 5):
        readings.append(_join_all(len(own)))
    further = _FURTHER * max(count - 2, 0)
    saved = 0.0
    if torn and not one:
        # arcs that point at places far apart belong to several junctions
        missed = _measure_miss(own) - _MISS if len(own) > 3 and tie is None else 0.0
        saved = (count - 1) * _TORN - min(max(missed, 0.0), _MAX_MISS)
    readings = [
        replace(reading, cost=reading.cost + further)
        if reading.pairs
        else replace(reading, cost=reading.cost + further - saved, place=tie, tied=tie is not None)
        for reading in readings
    ]
    return sorted(readings, key=lambda reading: reading.cost)


def price_level(
    own: Sequence[Port], hubs: Sequence[int], middle: Array, drawn: SurfaceMap, on_table: bool
) -> float:
    """Return what it costs that four ports are joined, by the heights of the best crossing."""
    return _read_four(own, hubs, middle, drawn, on_table, True, False)[-1].cost - 2.0 * _BRANCH


def _join_all(count: int) -> Reading:
    return Reading(_BRANCH * (count - 2), tuple(range(count)))


def _read_three(own: Sequence[Port], drawn: SurfaceMap, on_table: bool) -> list[Reading]:
    """Return a junction of three, and ends that lie on or under the strand of the other two."""
    if not on_table:
        return [_join_all(3)]
    unlike, ends = 0.0, []
    for number in range(3):
        others = (0, 1) if number == 2 else (0, 2) if number == 1 else (1, 2)
        end, some, other = own[number], own[others[0]], own[others[1]]
        radius = drawn.cell * end.half_width
        deviation = _measure_deviation(own, radius)
        bend = min(measure_angle(-inward, outward) for inward, outward in _pair_directions(some, other))
        straight = (bend / _BEND) ** 2 + _price_widths(some, other) + _LAID
        # a strand that is thicker than both has a higher surface
        thicker = end.thickness - max(some.thickness, other.thickness)
        rise = end.near - max(some.rest, other.rest) - max(thicker, 0.0)
        drop = end.near - end.rest
        # a bump of wires side by side is a tie
        is_tied = some.is_flat or other.is_flat
        bump = 0.0 if is_tied else min(some.near, other.near) - max(port.rest for port in own)
        # a strand that is short, or lies high for long, makes no bump
        lift = min(some.near - some.thickness, other.near - other.thickness) - end.near + end.thickness
        for under, heights in (
            (False, (rise - _LAID_RISE * radius, drop - _LAID_DROP * radius)),
            (True, (max(bump, lift) - _LAID_RISE * radius,)),
        ):
            low = sum(min(0.0, height) ** 2 for height in heights)
            cost = straight + _RISE_WEIGHT * low / deviation**2
            height = 0.5 * (some.near + other.near if under else some.rest + other.rest)
            ends.append(Reading(cost, (), (others,), (height,), (None,), number, under))
        level = max(0.0, min(rise, drop) - _LEVEL * radius, bump - _LEVEL * radius)
        unlike = max(unlike, _LEVEL_WEIGHT * (level / deviation) ** 2)
    return [Reading(_BRANCH + min(unlike, _MAX_UNLIKE), (0, 1, 2), unlike=unlike), *ends]


def _read_four(
    own: Sequence[Port],
    hubs: Sequence[int],
    middle: Array,
    drawn: SurfaceMap,
    on_table: bool,
    joined: bool,
    tied: bool,
) -> list[Reading]:
    """Return crossings, and a junction of four last."""
    radius = drawn.cell * float(np.mean([port.half_width for port in own]))
    lowest, top = np.percentile(drawn.sample_heights(middle), (_LOWEST, _TOP)).tolist()
    rest = max(port.rest for port in own)
    deviation = _measure_deviation(own, radius)
    room = _price_room(middle, rest, radius, drawn) if on_table else 0.0
    readings, levels = [], []
    for pairs in _PAIRINGS:
        across = _lie_across(own, pairs)
        turned = any(_turn_back(pair, hubs) for pair in pairs)
        # an arc as long as two half widths lies between the axes of strands that touch
        if turned and (across or not on_table or len(middle) > _TOUCH * sum(port.half_width for port in own)):
            continue
        first, second = (0.5 * (own[i].height + own[j].height) for i, j in pairs)
        # axes, as strands of different widths that lie on a table differ in their surfaces
        depths = [0.5 * (own[i].depth + own[j].depth) for i, j in pairs]
        rise = abs(first - depths[0] - second + depths[1])
        if on_table:
            rise = max(rise, top - rest)
        cost = room + sum(_price_continuation(own[i], own[j]) for i, j in pairs)
        # an end that lies on a strand makes a rise too
        level = _price_rise(rise, radius, deviation)
        if on_table and not across:
            # a branch has no valley
            valley = lowest - min(first, second) + _VALLEY * radius
            closed = _price_rise(valley, radius, deviation) if turned else 0.0
            cost += _MAX_LEVEL if tied else max(level, closed)
            readings.append(Reading(cost, (), pairs, (first, second), (first, second)))
        else:
            cost += _RISE_WEIGHT * (max(0.0, _RISE * radius - rise) / deviation) ** 2
            readings.append(Reading(cost, (), pairs, (first, second), (second, first)))
        levels.append(level)
    if joined:
        level = levels[int(np.argmin([reading.cost for reading in readings]))] if readings else 0.0
        readings.append(Reading(2.0 * _BRANCH + level, (0, 1, 2, 3)))
    return readings


def _read_five(
    own: Sequence[Port], hubs: Sequence[int], middle: Array, drawn: SurfaceMap, on_table: bool, joined: bool
) -> list[Reading]:
    """Return strands that pass a junction of three, and a junction of five last."""
    readings, levels = [], []
    top = float(np.percentile(drawn.sample_heights(middle), _TOP))
    base = max(port.rest for port in own)
    widths = drawn.cell * np.array([port.half_width for port in own])
    depths = np.array([port.depth for port in own])
    axes = np.array([port.height for port in own]) - depths
    radius = float(widths.mean())
    deviation = _measure_deviation(own, radius)
    for pair in combinations(range(5), 2):
        if _turn_back(pair, hubs):
            continue
        rest = tuple(number for number in range(5) if number not in pair)
        passing, joint = axes[list(pair)].mean(), axes[list(rest)].mean()
        rise = abs(float(passing - joint))
        if on_table:
            rise = max(rise, top - base)
        cost = _BRANCH + _price_continuation(own[pair[0]], own[pair[1]])
        astray, place = _find_meeting([own[number] for number in rest], middle)
        cost += astray
        cost += _RISE_WEIGHT * (max(0.0, _RISE * radius - rise) / deviation) ** 2
        apart = float(np.ptp(axes[list(rest)])) - _SPREAD * radius
        cost += min(_LEVEL_WEIGHT * (max(0.0, apart) / deviation) ** 2, _MAX_LEVEL)
        own_height = float(passing + depths[list(pair)].mean())
        other = float(joint + depths[list(rest)].mean())
        readings.append(Reading(cost, rest, (pair,), (own_height,), (other,), place=place))
        levels.append(_price_rise(rise, radius, deviation))
    if joined:
        level = levels[int(np.argmin([reading.cost for reading in readings]))] if readings else 0.0
        readings.append(Reading(3.0 * _BRANCH + level, tuple(range(5))))
    return readings


def _price_rise(rise: float, radius: float, deviation: float) -> float:
    """Return the cost of a rise, metres, at a place where all strands are joined."""
    return min(_LEVEL_WEIGHT * (max(0.0, rise - _LEVEL * radius) / deviation) ** 2, _MAX_LEVEL)


def _price_room(middle: Array, rest: float, radius: float, drawn: SurfaceMap) -> float:
    """Return the cost of two strands that share a long stretch, which is wide or high there."""
    half = radius / drawn.cell
    if len(middle) < _LONG * half:
        return 0.0
    wider = drawn.sample_widths(middle) / half - 1.0
    higher = (drawn.sample_heights(middle) - rest) / radius
    room = float(np.percentile(np.maximum(wider, higher), _NARROW))
    return min((max(0.0, _ROOM - room) / _ROOM_SD) ** 2, _MAX_LEVEL)


def _lie_across(own: Sequence[Port], pairs: Sequence[tuple[int, int]]) -> bool:
    """Tell whether two strands cross in the plan; others touch, side by side."""
    places = np.array([port.place for port in own])
    ways = places - places.mean(axis=0)
    turns = np.arctan2(ways[:, 1], ways[:, 0])
    (first, last), other = sorted(turns[list(pairs[0])]), turns[list(pairs[1])]
    return int(((other > first) & (other < last)).sum()) == 1


def _turn_back(pair: tuple[int, int], hubs: Sequence[int]) -> bool:
    """Tell whether a strand would go back at the first of several hubs that it meets."""
    some, other = (hubs[number] for number in pair)
    return some == other and len(set(hubs)) > 1 and list(hubs).count(some) == 2


def _price_continuation(some: Port, other: Port) -> float:
    """Return the cost of two ports that are one strand: bend, shift aside, difference of widths.

    It goes on as it points at the hub, as it points near the hub, or bent as outside: the cheapest counts.
    """
    way = other.place - some.place
    gap = max(float(np.linalg.norm(way)), 1e-9)
    turns = []
    for inward, outward in _pair_directions(some, other):
        side = measure_angle(-inward, way / gap) + measure_angle(outward, way / gap)
        turns.append(_price_turn(inward, outward, side))
    if gap < _MAX_BENT * (some.half_width + other.half_width):
        (first, inward), (second, outward) = (_continue_bent(port, 0.5 * gap) for port in (some, other))
        along = outward - inward
        along /= max(float(np.linalg.norm(along)), 1e-9)
        aside = second - first - ((second - first) @ along) * along
        turns.append(_price_turn(inward, outward, 2.0 * float(np.linalg.norm(aside)) / gap))
    return min(turns) + _price_widths(some, other)


def _price_turn(inward: Array, outward: Array, side: float) -> float:
    """Return the cost of a bend between two directions, and of a shift aside, radians."""
    return (measure_angle(-inward, outward) / _BEND) ** 2 + (side / _SIDE) ** 2


def _continue_bent(port: Port, way: float) -> tuple[Array, Array]:
    """Return the place (2,) and the direction (2,) of a port a way, cells, inwards, bent as it is outside."""
    turn = way * float(np.linalg.norm(port.curvature))
    curvature = port.curvature * min(_MAX_TURN / max(turn, 1e-9), 1.0)
    direction = port.direction - way * curvature
    direction /= max(float(np.linalg.norm(direction)), 1e-9)
    return port.place - way * port.direction + 0.5 * way**2 * curvature, direction


def _pair_directions(some: Port, other: Port) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Return the directions of two ports at their hubs, and those over the stretches near these.

    The first tell how a bent strand goes on. Where masks merge slowly, the others do: the middle line bends.
    """
    return (some.direction, other.direction), (some.mean_direction, other.mean_direction)


def _price_widths(some: Port, other: Port) -> float:
    """Return the cost of two ports of different widths that are one strand."""
    mean = 0.5 * (some.half_width + other.half_width)
    return ((some.half_width - other.half_width) / mean / _WIDTH) ** 2


def _find_meeting(own: Sequence[Port], middle: Array) -> tuple[float, Array]:
    """Return what it costs that ports point past the cell where they meet, and the cell: the best one."""
    costs = np.zeros(len(middle))
    for port in own:
        ways = middle - port.place
        ways /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 1e-9)
        costs += (np.arccos(np.clip(-ways @ port.direction, -1.0, 1.0)) / _SIDE) ** 2
    best = int(costs.argmin())
    return float(costs[best]), middle[best]


def _measure_miss(own: Sequence[Port]) -> float:
    """Return the least sum of squared distances of ports' lines from one place, half widths."""
    across = [(np.eye(2) - np.outer(port.direction, port.direction)) / port.half_width for port in own]
    ways = np.concatenate([matrix @ port.place for matrix, port in zip(across, own, strict=True)])
    place = np.linalg.lstsq(np.concatenate(across), ways, rcond=None)[0]
    return float(np.sum((np.concatenate(across) @ place - ways) ** 2))


def _measure_deviation(own: Sequence[Port], radius: float) -> float:
    """Return the standard deviation of a difference of heights, metres: of noise, and of strands' waves."""
    return float(np.hypot(_RISE_SD * radius, np.mean([port.scatter for port in own])))
