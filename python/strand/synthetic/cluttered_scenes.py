"""A rope on a table among other things, as a camera over a workplace sees it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_bool, check_integer
from strand.synthetic.camera import Camera, camera_pose, find_least_distance, spread_azimuths
from strand.synthetic.noise import Noise, sense
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.rendering import render_depth
from strand.synthetic.scenes import SyntheticScene
from strand.synthetic.things import Ball, Box, Cylinder, Thing, cast
from strand.views.pose import moved

_CAMERA = Camera(size=(640, 480))
_DEPTH_SD = 0.001  # metres: noise of the depths
_FLYING = 0.05  # fraction of the pixels at steps in depth that fly
_POSE_NOISE = Noise(turn=math.radians(0.4), shift=0.001)
_RADII = (0.0035, 0.006)
_DISTANCES, _ELEVATIONS = (0.5, 0.75), (math.radians(45.0), math.radians(80.0))
_TABLE = 3.0  # side, metres
_TILT, _SHIFT = math.radians(35.0), 0.5  # of the table in the world frame, radians and metres
_CROSSINGS = 3  # most
_ROPES, _PLACES = 60, 300  # that are drawn at most, of a rope and of things around it
_AWAY = 0.012  # metres between a rope and things that stand on the table, in plan
_AROUND = 0.28  # metres from the middle within which things are
# what things hide of a rope in a view: at most so many radii in a row, none nearer to its ends than this
_HIDDEN, _END = 8.0, 5.0


def cluttered_scene(seed: int = 0, *, views: int | None = None, rope: bool = True) -> SyntheticScene:
    """Draw a rope on a table with a gripper, a mug, a box, a ball and a post.

    Depths of 640 x 480 pixels have 1 mm of independent noise. The table is tilted in the world frame; one
    camera alone has the identity as its pose. The rope crosses itself at most three times. Things stand
    beside it, the gripper floats above the table; they hide at most 8 radii of it at a time, and of several
    views one sees each place. There is no mask, and the bounds hold the whole table.

    Parameters
    ----------
    seed : int
        The source of chance, not negative.
    views : int, optional
        How many images; if not given, 1 and 3 take turns.
    rope : bool
        Whether there is a rope; without one the truth is empty, and the radius that of the rope left out.

    Returns
    -------
    SyntheticScene

    Raises
    ------
    TypeError
        If an argument is not of its type.
    ValueError
        If `seed` is negative or `views` is not positive.
    """
    seed, rope = check_integer("seed", seed), check_bool("rope", rope)
    count = (1, 3)[seed % 2] if views is None else check_integer("views", views, 1)
    rng = np.random.default_rng([seed, count])
    intrinsics = _CAMERA.intrinsics
    radius = float(rng.uniform(*_RADII))
    elevation = float(rng.uniform(*_ELEVATIONS))
    nodes, distance = _rope(rng, radius, count, elevation)
    poses = np.stack([camera_pose(azimuth, distance, elevation) for azimuth in spread_azimuths(count)])

    def exact(ropes: list[Array], things: list[Thing]) -> list[Array]:
        empty = [render_depth(ropes, radius, intrinsics, pose, _CAMERA.size, _TABLE) for pose in poses]
        return [cast(depth, things, intrinsics, pose) for depth, pose in zip(empty, poses, strict=True)]

    sampled = nodes[:: max(1, round(radius / float(np.linalg.norm(nodes[1] - nodes[0]))))]
    for _ in range(_PLACES):
        things = _things(rng, nodes)
        if things is None:
            continue
        hidden = [
            _hidden(sampled, radius, depth, intrinsics, pose)
            for depth, pose in zip(exact([], things), poses, strict=True)
        ]
        if not rope or _shown(hidden):
            break
    else:
        things = []
    images = [
        sense(depth, noise=_DEPTH_SD, flying=_FLYING, step=radius, depth_scale=_CAMERA.depth_scale, rng=rng)
        for depth in exact([nodes] if rope else [], things)
    ]
    reported = _POSE_NOISE.misplace(poses, rng)
    world = np.linalg.inv(poses[0]) if count == 1 else _tilted(rng)
    if count == 1:
        seen_from = reported = np.eye(4)[None]
    else:
        seen_from, reported = world @ poses, world @ reported
    corners = _TABLE * np.stack(np.meshgrid(*[(-0.5, 0.5)] * 3), axis=-1).reshape(-1, 3)
    placed = moved(corners, world)
    return SyntheticScene(
        name=f"{'cluttered' if rope else 'without_rope'}{seed:02d}_{count}v",
        depth=np.stack(images),
        depth_scale=_CAMERA.depth_scale,
        intrinsics=intrinsics,
        poses=reported,
        poses_true=seen_from,
        bounds=(placed.min(axis=0), placed.max(axis=0)),
        radius=radius,
        truth=(moved(nodes, world),) if rope else (),
        noise=_DEPTH_SD,
    )


def _rope(rng: np.random.Generator, radius: float, count: int, elevation: float) -> tuple[Array, float]:
    """Return a rope that all views hold, and the distance of the cameras, metres."""
    for _ in range(_ROPES):
        crossings = int(rng.integers(0, _CROSSINGS + 1))
        try:
            (nodes,) = random_ropes(crossings, 1, radius, int(rng.integers(1 << 31)))
        except ValueError:
            continue  # no rope that crosses so often was found
        distance = max(
            find_least_distance(nodes, radius, spread_azimuths(count), elevation, _CAMERA.size),
            float(rng.uniform(*_DISTANCES)),
        )
        if distance <= _DISTANCES[1]:
            return nodes, distance
    straight = np.linspace(-12.0 * radius, 12.0 * radius, 100)
    return np.stack([straight, np.zeros(100), np.full(100, radius)], axis=1), _DISTANCES[1]


def _things(rng: np.random.Generator, nodes: Array) -> list[Thing] | None:
    """Draw a gripper, a mug, a box, a ball and a post beside a rope; None if two are in one place."""
    length, width, height = rng.uniform((0.05, 0.04, 0.03), (0.12, 0.09, 0.08))
    ball, post, mug = rng.uniform(0.02, 0.04), rng.uniform(0.008, 0.015), rng.uniform(0.035, 0.045)
    half = 0.5 * math.hypot(length, width)
    # half of what each covers in plan; the handle is beside the mug, the gripper floats
    covered = np.array([half, ball, post, mug + 0.035, 0.05])
    places = rng.uniform(-_AROUND, _AROUND, (5, 2))
    apart = np.linalg.norm(places[:, None] - places, axis=2) - covered[:, None] - covered
    if (apart[np.triu_indices(5, 1)] < 0.0).any():
        return None
    beside = np.linalg.norm(places[:4, None] - nodes[:, :2], axis=2).min(axis=1) - covered[:4]
    if (beside < _AWAY).any():
        return None
    turn, way, tall = rng.uniform(0.0, 2.0 * math.pi, 3)
    (bx, by), (cx, cy), (px, py), (mx, my), (gx, gy) = places
    clear = float(rng.uniform(0.03, 0.06))
    across = np.array([math.cos(tall), math.sin(tall)])
    fingers = [np.array([gx, gy]) + side * 0.03 * across for side in (-1.0, 1.0)]
    handle = _handle(mx, my, mug, way)
    return [
        Box((bx, by, 0.5 * height), (length, width, height), turn),
        Ball((cx, cy, ball), ball),
        Cylinder((px, py, 0.0), post, float(rng.uniform(0.06, 0.15))),
        Cylinder((mx, my, 0.0), mug, 0.09, hollow=True),
        *handle,
        *(Box((x, y, clear + 0.03), (0.012, 0.022, 0.06), tall) for x, y in fingers),
        Box((gx, gy, clear + 0.085), (0.1, 0.05, 0.05), tall),
    ]


def _handle(x: float, y: float, radius: float, way: float) -> list[Thing]:
    """Return a mug's handle: balls along an upright arc beside it."""
    outward = np.array([math.cos(way), math.sin(way), 0.0])
    middle = np.array([x, y, 0.045]) + radius * outward
    turns = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 40)
    arc = middle + 0.028 * (np.cos(turns)[:, None] * outward + np.sin(turns)[:, None] * [0.0, 0.0, 1.0])
    return [Ball((float(a), float(b), float(c)), 0.006) for a, b, c in arc]


def _hidden(nodes: Array, radius: float, depth: Array, intrinsics: Array, pose: Array) -> NDArray[np.bool_]:
    """(M,) Which nodes something stands before."""
    x, y, z = ((nodes - pose[:3, 3]) @ pose[:3, :3]).T
    columns = np.rint(intrinsics[0, 0] * x / z + intrinsics[0, 2]).astype(np.int64)
    rows = np.rint(intrinsics[1, 1] * y / z + intrinsics[1, 2]).astype(np.int64)
    inside = (rows >= 0) & (rows < depth.shape[0]) & (columns >= 0) & (columns < depth.shape[1])
    hides = ~inside
    hides[inside] = depth[rows[inside], columns[inside]] < z[inside] - 2.0 * radius
    return np.asarray(hides)


def _shown(hidden: list[NDArray[np.bool_]]) -> bool:
    """Whether views show as much of a rope as wanted; its nodes are a radius apart."""
    ends = round(_END)
    if any(part[:ends].any() or part[-ends:].any() for part in hidden):
        return False
    if len(hidden) > 1:
        return not np.all(hidden, axis=0).any()
    steps = np.flatnonzero(np.diff(np.concatenate([[0], hidden[0].astype(np.int8), [0]])))
    return bool((np.diff(steps)[::2] <= _HIDDEN).all())


def _tilted(rng: np.random.Generator) -> Array:
    """Return a rigid motion of the table's frame in the world."""
    axis = rng.normal(size=3) * (1.0, 1.0, 0.0)
    angle = float(rng.uniform(0.0, _TILT))
    x, y, z = axis / np.linalg.norm(axis)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    motion = np.eye(4)
    motion[:3, :3] += math.sin(angle) * skew + (1.0 - math.cos(angle)) * (skew @ skew)
    motion[:3, 3] = rng.uniform(-_SHIFT, _SHIFT, 3)
    return motion
