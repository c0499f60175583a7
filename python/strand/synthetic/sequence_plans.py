"""Plans of simulated sequences: how ropes lie at first, and how grippers move them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from strand.support.checks import Array
from strand.synthetic.grippers import GripperPath, ease, find_duration, smooth_corners
from strand.synthetic.noise import make_plane_rotation
from strand.synthetic.rope_motion import STEP

DURATION = 3.0
"""Time within which all movements end, seconds."""

_RADII = (0.0035, 0.005)  # metres: range of the ropes' radius
_SPACING = 1.3  # radii between nodes
_MOST_NODES = 130  # of one rope; longer ropes have nodes farther apart
_REST = (0.21, 0.3)  # seconds: range of the time before the first movement
_HALF = (0.005, 0.0085)  # metres: half the length of rope between the fingers
_TAIL = 0.004  # metres of rope beyond the fingers
_CARRY_SPEED = (0.25, 0.5)  # m / s: greatest speed of a gripper over the table
_END = 2.75  # seconds: movements over the table end
_WHOLE_END = 2.3  # seconds: the same, of those that must not end before
_LIFT = (0.03, 0.06)  # metres: height of an end that is carried
_LEAVE_WAY = (0.15, 0.06)  # metres that an open gripper goes away from the rope's end, and up
_LEAVE = 0.5  # seconds in which an open gripper goes away
_WAVE_SPEED = (0.8, 1.1)  # m / s: greatest speed of grippers that wave
_WAVE_FASTEST = 1.45  # m / s: greatest speed of a rope that is waved
_WAVE_RATES = (1.5, 2.0)  # Hz: faster than the rope swings by itself
_WAVE_HEIGHT = 0.36  # metres: of the grippers above the table
_WAVE_END = 2.7  # seconds: the grippers come to rest
_WAVE_RAMP = 0.5  # seconds: in which waving begins, and ends
_TABLE_SETTLE = 0.8  # seconds: for ropes on the table to come to rest
_AIR_SETTLE = 1.8  # seconds: the same, for ropes in the air
_TABLE_ELEVATIONS = (math.radians(50.0), math.radians(78.0))  # radians: of cameras over a table
_AIR_ELEVATIONS = (math.radians(25.0), math.radians(45.0))  # radians: of cameras before a rope in the air
_MAX_TURN = math.radians(25.0)  # radians: of the whole about z


@dataclass(frozen=True, eq=False)
class Plan:
    """Ropes, the grippers that move them, and the cameras' elevation, radians.

    Lengths are in metres, in the world frame. `settle` is the time to come to rest at first, seconds.
    `fastest` is the greatest speed that nodes may have, m / s.
    """

    radius: float
    ropes: tuple[Array, ...]
    spacings: tuple[float, ...]
    grippers: tuple[GripperPath, ...]
    elevation: float
    settle: float = _TABLE_SETTLE
    fastest: float = math.inf

    def make_smaller(self, factor: float) -> Plan:
        """Return the plan with movements of grippers that are smaller by a factor."""
        paths = tuple(
            replace(path, places=path.places[0] + factor * (path.places - path.places[0]))
            for path in self.grippers
        )
        return replace(self, grippers=paths)


def plan_sequence(kind: str, rng: np.random.Generator) -> Plan:
    """Return the plan of one of the kinds of `sequence`."""
    radius = float(rng.uniform(*_RADII))
    match kind:
        case "wave" | "barwave":
            plan = _plan_wave(rng, radius)
        case "loop" | "unloop":
            plan = _plan_loop(rng, radius, kind == "unloop")
        case "two":
            plan = _plan_two(rng, radius)
        case "slide":
            plan = _plan_slide(rng, radius)
        case "still":
            nodes, spacing = _lay_wavy(rng, float(rng.uniform(0.4, 0.8)), radius)
            plan = Plan(radius, (nodes,), (spacing,), (), _draw_elevation(rng))
        case _:
            plan = _plan_carry(rng, radius)
    # the gripper of `unloop` stands behind the crossing, which it would hide otherwise
    mirror = bool(rng.random() < 0.5) or kind == "unloop"
    return _turn_plan(plan, float(rng.uniform(-_MAX_TURN, _MAX_TURN)), mirror)


def _draw_elevation(rng: np.random.Generator) -> float:
    return float(rng.uniform(*_TABLE_ELEVATIONS))


def _find_spacing(length: float, radius: float) -> tuple[int, float]:
    """Return the number of nodes of a rope and their distance, metres."""
    count = min(round(length / (_SPACING * radius)) + 1, _MOST_NODES)
    return count, length / (count - 1)


def _lay_heading(heading: Array, spacing: float, radius: float) -> Array:
    """Return the nodes of a rope on the table from the directions of its segments, radians from y."""
    steps = spacing * np.column_stack([-np.sin(heading), np.cos(heading), np.zeros(len(heading))])
    nodes = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    nodes[:, 2] = radius
    return nodes


def _lay_wavy(
    rng: np.random.Generator, length: float, radius: float, sway: float = 0.5
) -> tuple[Array, float]:
    """Return a rope with gentle bends, along y on the whole, with its middle at the origin."""
    count, spacing = _find_spacing(length, radius)
    at = (np.arange(count - 1) + 0.5) * spacing
    waves = [(float(rng.uniform(0.25, 0.5)), float(rng.uniform(0.0, 2.0 * math.pi))) for _ in range(2)]
    heading = sway * sum(np.sin(2.0 * math.pi * at / wave + phase) for wave, phase in waves)
    nodes = _lay_heading(np.asarray(heading) - np.mean(heading), spacing, radius)
    nodes[:, :2] -= 0.5 * (nodes[:, :2].max(axis=0) + nodes[:, :2].min(axis=0))
    return nodes, spacing


def _grip_end(
    rng: np.random.Generator, nodes: Array, spacing: float, first: bool = False
) -> tuple[float, float, Array]:
    """Return where a gripper holds an end, half its width, and its place and turn (x, y, z, angle)."""
    half = float(rng.uniform(*_HALF))
    length = spacing * (len(nodes) - 1)
    s = half + _TAIL if first else length - half - _TAIL
    along = np.arange(len(nodes)) * spacing
    place = [np.interp(s, along, axis) for axis in nodes.T]
    held = np.flatnonzero(np.abs(along - s) <= half + spacing)
    way = nodes[held[-1]] - nodes[held[0]]
    return s, half, np.array([*place, math.atan2(way[1], way[0])])


def _follow(
    rope: int,
    s: float,
    half: float,
    corners: Array,
    begin: float,
    speed: float,
    released: bool = False,
    whole: bool = False,
) -> GripperPath:
    """Return a movement along corners (K, 4) of places and turns, with a greatest speed, m / s.

    The movement ends early if it is long. If it must be the `whole` one, it is faster.
    """
    line = smooth_corners(corners)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line[:, :3], axis=0), axis=1))])
    way, most = float(along[-1]), (_WHOLE_END if whole else _END) - begin
    too_long = max(find_duration(way, speed) / most, 1.0)
    way, speed = (way, speed * too_long) if whole else (way / too_long, speed)
    duration = find_duration(way, speed)
    times = np.arange(0.0, DURATION + 1.0, STEP)
    at = way * ease((times - begin) / duration)
    path = np.column_stack([np.interp(at, along, axis) for axis in line.T])
    release = math.inf
    if released:
        release = begin + duration + 0.05
        # it goes up and away from the rope's end
        leave = ease((times - release) / _LEAVE)
        aside, up = _LEAVE_WAY
        path[:, 0] += aside * math.cos(path[-1, 3]) * leave
        path[:, 1] += aside * math.sin(path[-1, 3]) * leave
        path[:, 2] += up * leave
    return GripperPath(rope, s, half, times, path[:, :3], path[:, 3], release)


def _plan_carry(rng: np.random.Generator, radius: float) -> Plan:
    """Return a plan in which an end is carried over the table, to one side of the rope and to the other."""
    nodes, spacing = _lay_wavy(rng, float(rng.uniform(0.4, 0.7)), radius)
    nodes[:, 1] -= 0.06
    s, half, start = _grip_end(rng, nodes, spacing)
    side = float(rng.choice([-1.0, 1.0]))
    lift, speed = float(rng.uniform(*_LIFT)), float(rng.uniform(*_CARRY_SPEED))
    # around a place of the rope, at a distance that the rope has, less some slack
    center = nodes[round(float(rng.uniform(0.35, 0.5)) * len(nodes))]
    away = start[:3] - center
    angle, reach = math.atan2(away[1], away[0]), math.hypot(away[0], away[1])
    sweep, back = float(rng.uniform(0.7, 1.2)), float(rng.uniform(1.0, 1.8))
    corners = [start, start + np.array([0.0, 0.0, lift, 0.0])]
    for turn in (0.5 * sweep, sweep, sweep - 0.5 * back, sweep - back):
        size, way = reach * float(rng.uniform(0.8, 1.0)), angle + side * turn
        place = center[:2] + size * np.array([math.cos(way), math.sin(way)])
        corners.append(np.array([*place, radius + lift, start[3] + 0.7 * side * turn]))
    corners.append(corners[-1] + np.array([0.0, 0.0, 0.005 - lift, 0.0]))
    path = _follow(0, s, half, np.array(corners), float(rng.uniform(*_REST)), speed)
    return Plan(radius, (nodes,), (spacing,), (path,), _draw_elevation(rng))


def _plan_slide(rng: np.random.Generator, radius: float) -> Plan:
    """Return a plan in which a rope is pulled along its own axis."""
    nodes, spacing = _lay_wavy(rng, float(rng.uniform(0.4, 0.52)), radius, sway=0.06)
    reach = float(rng.uniform(0.15, 0.28))
    nodes[:, 1] -= 0.5 * reach
    s, half, start = _grip_end(rng, nodes, spacing)
    way = reach * np.array([math.cos(start[3]), math.sin(start[3]), 0.0, 0.0])
    corners = np.array([start, start + 0.5 * way, start + way])
    path = _follow(0, s, half, corners, float(rng.uniform(*_REST)), float(rng.uniform(0.15, 0.3)))
    return Plan(radius, (nodes,), (spacing,), (path,), _draw_elevation(rng))


def _plan_two(rng: np.random.Generator, radius: float) -> Plan:
    """Return a plan in which the end of one rope is carried over another rope and laid down."""
    carried, spacing = _lay_wavy(rng, float(rng.uniform(0.42, 0.55)), radius, sway=0.15)
    other, other_spacing = _lay_wavy(rng, float(rng.uniform(0.4, 0.55)), radius, sway=0.15)
    apart = float(rng.uniform(0.07, 0.1))
    carried[:, 0] += apart + carried[:, 0].max() - other[:, 0].min() - carried[-1, 0]
    carried[:, 0] -= min(0.0, float(carried[:, 0].min() - other[:, 0].max()) - 0.04)
    carried[:, 1] -= carried[:, 1].max() - float(rng.uniform(0.1, 0.2))
    s, half, start = _grip_end(rng, carried, spacing)
    over = float(other[:, 0].min()) - float(rng.uniform(0.06, 0.1)) - start[0]
    lift, aside = float(rng.uniform(0.045, 0.06)), float(rng.uniform(-0.12, 0.02))
    turn = float(rng.uniform(0.7, 1.4))
    corners = start + np.array(
        [
            [0.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, lift, 0.0],
            [0.5 * over, 0.5 * aside, lift, 0.5 * turn],
            [over, aside, lift, turn],
            [over, aside, 0.004, turn],
        ]
    )
    speed = float(rng.uniform(*_CARRY_SPEED))
    path = _follow(0, s, half, corners, float(rng.uniform(*_REST)), speed, released=True, whole=True)
    return Plan(radius, (carried, other), (spacing, other_spacing), (path,), _draw_elevation(rng))


def _plan_loop(rng: np.random.Generator, radius: float, undo: bool) -> Plan:
    """Return a plan in which an end is carried round over its rope, or back.

    The loop turns left by 270 degrees around a circle. Before it, the rope runs along y; after it, it crosses
    over that stretch.
    """
    bend = float(rng.uniform(0.036, 0.045))
    tail = float(rng.uniform(0.05, 0.07))
    before = float(rng.uniform(0.14, 0.22)) + bend
    length = before + (1.5 * math.pi + 1.0) * bend + tail
    count, spacing = _find_spacing(length, radius)
    at = (np.arange(count - 1) + 0.5) * spacing
    turned = 1.5 * math.pi * np.clip((at - before) / (1.5 * math.pi * bend), 0.0, 1.0)
    soft = np.exp(-0.5 * (np.arange(-4.0, 4.5) * spacing / (0.3 * bend)) ** 2)
    padded = np.concatenate([np.full(4, turned[0]), turned, np.full(4, turned[-1])])
    turned = np.convolve(padded, soft / soft.sum(), mode="valid")
    loop = _lay_heading(turned, spacing, radius)
    crossed = length - tail
    loop[:, 2] += 2.2 * radius * np.exp(-0.5 * ((np.arange(count) * spacing - crossed) / (5.0 * radius)) ** 2)
    straight = _lay_heading(np.zeros(count - 1), spacing, radius)
    shift = np.array([0.0, before, 0.0])
    loop, straight = loop - shift, straight - shift
    s, half, laid = _grip_end(rng, loop, spacing)
    laid[3] += 2.0 * math.pi  # it runs along x after 270 degrees of turn from y
    extended = np.array([0.0, 0.92 * (s - before), radius, 0.5 * math.pi])
    lift = float(rng.uniform(0.045, 0.06)) + radius
    top = np.array([0.0, 0.0, lift - radius, 0.0])
    corners = np.array(
        [
            extended,
            extended + top,
            [-2.2 * bend, 4.2 * bend, lift, 0.8 * math.pi],
            [-3.4 * bend, 1.2 * bend, lift, 1.3 * math.pi],
            [-1.9 * bend, -0.9 * bend, lift, 1.8 * math.pi],
            laid + top,
            laid + np.array([0.0, 0.0, 0.002, 0.0]),
        ]
    )
    speed = float(rng.uniform(0.3, 0.45))
    begin = float(rng.uniform(*_REST))
    if undo:
        # the gripper turns so that the rope follows it
        corners[-1] = laid
        corners[:, 3] = math.pi * np.array([0.5, 0.5, 0.4, 0.55, 0.35, 0.0, 0.0])
        corners[-2:, 3] = laid[3] - 2.0 * math.pi
        path = _follow(0, s, half, corners[::-1], begin, speed, whole=True)
        nodes = loop
    else:
        corners[:2] = _grip_end(rng, straight, spacing)[2]
        corners[1] += top
        path = _follow(0, s, half, corners, begin, speed, released=True, whole=True)
        nodes = straight
    return Plan(radius, (nodes,), (spacing,), (path,), _draw_elevation(rng))


def _plan_wave(rng: np.random.Generator, radius: float) -> Plan:
    """Return a plan in which two grippers wave a rope in the air."""
    length = float(rng.uniform(0.42, 0.6))
    count, spacing = _find_spacing(length, radius)
    span = float(rng.uniform(0.62, 0.78)) * length
    nodes = _hang(count, spacing, span)
    nodes[:, 2] += _WAVE_HEIGHT - nodes[0, 2]
    times = np.arange(0.0, DURATION + 1.0, STEP)
    begin = float(rng.uniform(*_REST))
    fade = ease((times - begin) / _WAVE_RAMP) * ease((_WAVE_END - times) / _WAVE_RAMP)
    speed, rate = float(rng.uniform(*_WAVE_SPEED)), float(rng.uniform(*_WAVE_RATES))
    phases, paths = rng.uniform(0.0, 2.0 * math.pi, 3), []
    for first in (True, False):
        s, half, start = _grip_end(rng, nodes, spacing, first)
        start[3] = 0.5 * math.pi
        way = np.zeros((len(times), 3))
        # across, along and up; along is least, as it would pull the rope tight
        for axis, size in enumerate((0.3, 0.15, 1.0)):
            # both grippers move alike on the whole, as the rope would be pulled tight otherwise
            own, phase = rate * float(rng.uniform(0.95, 1.05)), phases[axis] + float(rng.uniform(-0.5, 0.5))
            swing = np.sin(2.0 * math.pi * own * (times - begin) + phase)
            way[:, axis] = size * float(rng.uniform(0.7, 1.0)) * fade * swing
        greatest = np.linalg.norm(np.diff(way, axis=0), axis=1).max() / STEP
        way *= speed / greatest
        turns = start[3] + fade * 0.3 * np.sin(2.0 * math.pi * rate * (times - begin))
        paths.append(GripperPath(0, s, half, times, start[:3] + way, turns))
    elevation = float(rng.uniform(*_AIR_ELEVATIONS))
    return Plan(radius, (nodes,), (spacing,), tuple(paths), elevation, _AIR_SETTLE, _WAVE_FASTEST)


def _hang(count: int, spacing: float, span: float) -> Array:
    """Return nodes along a parabola that hangs between ends at a distance along y, metres."""
    y = np.linspace(-0.5 * span, 0.5 * span, 2000)
    low, high = 0.0, 4.0 * spacing * count / span**2
    for _ in range(40):
        middle = 0.5 * (low + high)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(y), np.diff(middle * y**2)))])
        low, high = (middle, high) if along[-1] < spacing * (count - 1) else (low, middle)
    at = np.interp(np.linspace(0.0, along[-1], count), along, y)
    return np.column_stack([np.zeros(count), at, middle * at**2])


def _turn_plan(plan: Plan, angle: float, mirror: bool) -> Plan:
    """Return a plan turned about z, and mirrored in x at first."""
    plane = make_plane_rotation(angle) @ np.diag([-1.0 if mirror else 1.0, 1.0])

    def turn(places: Array) -> Array:
        return np.column_stack([places[:, :2] @ plane.T, places[:, 2]])

    paths = tuple(
        replace(
            path,
            places=turn(path.places),
            turns=(math.pi - path.turns if mirror else path.turns) + angle,
        )
        for path in plan.grippers
    )
    return replace(plan, ropes=tuple(turn(nodes) for nodes in plan.ropes), grippers=paths)
