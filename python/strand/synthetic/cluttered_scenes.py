"""Scenes of a rope among other objects on a table."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array, check_bool, check_integer
from strand.synthetic.camera import Camera, camera_pose, find_least_distance, spread_azimuths
from strand.synthetic.noise import DEFAULT_FLYING, Noise, sense
from strand.synthetic.objects import Ball, Box, Cylinder, Object, add_objects
from strand.synthetic.random_curves import random_ropes
from strand.synthetic.rendering import render_depth
from strand.synthetic.scenes import SyntheticScene
from strand.views.pose import moved

_CAMERA = Camera(size=(640, 480))
_DEPTH_SD = 0.001  # metres: noise of the depths
_POSE_NOISE = Noise(turn=math.radians(0.4), shift=0.001)
_RADII = (0.0035, 0.006)  # metres: range of the rope's radius
_DISTANCES = (0.5, 0.75)  # metres: range of the cameras' distance from the origin
_ELEVATIONS = (math.radians(45.0), math.radians(80.0))  # radians: range of the cameras' elevation
_TABLE = 3.0  # metres: side of the table
_MAX_TILT = math.radians(35.0)  # radians, of the table in the world frame
_MAX_SHIFT = 0.5  # metres, of the table in the world frame
_MAX_CROSSINGS = 3  # crossings of the rope with itself
_MAX_ROPE_DRAWS = 60  # ropes drawn until one fits in all views
_MAX_OBJECT_DRAWS = 300  # arrangements of objects drawn until one hides little enough of the rope
_MIN_GAP = 0.012  # metres: smallest distance in plan between the rope and an object on the table
_MAX_OFFSET = 0.28  # metres: largest coordinate of an object in x and y
_MAX_HIDDEN = 8.0  # radii: longest stretch of rope that objects hide in a single view
_END_NODES = 5  # nodes, one radius apart, at each end of the rope that objects do not hide


def cluttered_scene(seed: int = 0, *, views: int | None = None, rope: bool = True) -> SyntheticScene:
    """Draw a rope on a table with a gripper, a mug, a box, a ball and a post.

    - The images have 640 x 480 pixels, with independent depth noise of 1 mm.
    - The table is tilted in the world frame. A single camera has the identity as its pose.
    - The rope crosses itself at most three times. Objects stand beside it, and the gripper floats.
    - A single view hides at most 8 radii of rope at a time. With several views, one of them sees each place.
    - There is no mask, and the bounds hold the whole table.

    Parameters
    ----------
    seed : int
        Seed of the random numbers, not negative.
    views : int, optional
        Number of images; by default 1 for even seeds and 3 for odd ones.
    rope : bool
        Whether there is a rope. Without one, the truth is empty, and `radius` is that of the omitted rope.

    Returns
    -------
    SyntheticScene

    Raises
    ------
    TypeError
        If an argument has the wrong type.
    ValueError
        If `seed` is negative or `views` is not positive.
    """
    seed, rope = check_integer("seed", seed), check_bool("rope", rope)
    count = (1, 3)[seed % 2] if views is None else check_integer("views", views, 1)
    rng = np.random.default_rng([seed, count])
    intrinsics = _CAMERA.intrinsics
    radius = float(rng.uniform(*_RADII))
    elevation = float(rng.uniform(*_ELEVATIONS))
    nodes, distance = _draw_rope(rng, radius, count, elevation)
    poses = np.stack([camera_pose(azimuth, distance, elevation) for azimuth in spread_azimuths(count)])

    def render(ropes: list[Array], objects: list[Object]) -> list[Array]:
        empty = [render_depth(ropes, radius, intrinsics, pose, _CAMERA.size, _TABLE) for pose in poses]
        return [
            add_objects(depth, objects, intrinsics, pose) for depth, pose in zip(empty, poses, strict=True)
        ]

    sampled = nodes[:: max(1, round(radius / float(np.linalg.norm(nodes[1] - nodes[0]))))]
    for _ in range(_MAX_OBJECT_DRAWS):
        objects = _draw_objects(rng, nodes)
        if objects is None:
            continue
        hidden = [
            _find_hidden(sampled, radius, depth, intrinsics, pose)
            for depth, pose in zip(render([], objects), poses, strict=True)
        ]
        if not rope or _is_shown(hidden):
            break
    else:
        objects = []
    images = [
        sense(
            depth,
            noise=_DEPTH_SD,
            flying=DEFAULT_FLYING,
            step=radius,
            depth_scale=_CAMERA.depth_scale,
            rng=rng,
        )
        for depth in render([nodes] if rope else [], objects)
    ]
    reported = _POSE_NOISE.misplace(poses, rng)
    world = np.linalg.inv(poses[0]) if count == 1 else _draw_tilt(rng)
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


def _draw_rope(rng: np.random.Generator, radius: float, count: int, elevation: float) -> tuple[Array, float]:
    """Return a rope that fits in all views, and the cameras' distance, metres."""
    for _ in range(_MAX_ROPE_DRAWS):
        crossings = int(rng.integers(0, _MAX_CROSSINGS + 1))
        try:
            (nodes,) = random_ropes(crossings, 1, radius, int(rng.integers(1 << 31)))
        except ValueError:
            continue  # no rope with this number of crossings was found
        distance = max(
            find_least_distance(nodes, radius, spread_azimuths(count), elevation, _CAMERA.size),
            float(rng.uniform(*_DISTANCES)),
        )
        if distance <= _DISTANCES[1]:
            return nodes, distance
    straight = np.linspace(-12.0 * radius, 12.0 * radius, 100)
    return np.stack([straight, np.zeros(100), np.full(100, radius)], axis=1), _DISTANCES[1]


def _draw_objects(rng: np.random.Generator, nodes: Array) -> list[Object] | None:
    """Draw a gripper, a mug, a box, a ball and a post beside a rope; None if two of them overlap."""
    length, width, height = rng.uniform((0.05, 0.04, 0.03), (0.12, 0.09, 0.08))
    ball, post, mug = rng.uniform(0.02, 0.04), rng.uniform(0.008, 0.015), rng.uniform(0.035, 0.045)
    half = 0.5 * math.hypot(length, width)
    # half the width of each in plan; the mug has a handle beside it
    halves = np.array([half, ball, post, mug + 0.035, 0.05])
    places = rng.uniform(-_MAX_OFFSET, _MAX_OFFSET, (5, 2))
    gaps = np.linalg.norm(places[:, None] - places, axis=2) - halves[:, None] - halves
    if (gaps[np.triu_indices(5, 1)] < 0.0).any():
        return None
    beside = np.linalg.norm(places[:4, None] - nodes[:, :2], axis=2).min(axis=1) - halves[:4]
    if (beside < _MIN_GAP).any():
        return None
    box_turn, handle_turn, gripper_turn = rng.uniform(0.0, 2.0 * math.pi, 3)
    (bx, by), (cx, cy), (px, py), (mx, my), (gx, gy) = places
    clearance = float(rng.uniform(0.03, 0.06))
    across = np.array([math.cos(gripper_turn), math.sin(gripper_turn)])
    fingers = [np.array([gx, gy]) + side * 0.03 * across for side in (-1.0, 1.0)]
    handle = _make_handle(mx, my, mug, handle_turn)
    return [
        Box((bx, by, 0.5 * height), (length, width, height), box_turn),
        Ball((cx, cy, ball), ball),
        Cylinder((px, py, 0.0), post, float(rng.uniform(0.06, 0.15))),
        Cylinder((mx, my, 0.0), mug, 0.09, hollow=True),
        *handle,
        *(Box((x, y, clearance + 0.03), (0.012, 0.022, 0.06), gripper_turn) for x, y in fingers),
        Box((gx, gy, clearance + 0.085), (0.1, 0.05, 0.05), gripper_turn),
    ]


def _make_handle(x: float, y: float, radius: float, turn: float) -> list[Object]:
    """Return a mug's handle, made of balls along an upright arc beside it."""
    outward = np.array([math.cos(turn), math.sin(turn), 0.0])
    middle = np.array([x, y, 0.045]) + radius * outward
    angles = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 40)
    arc = middle + 0.028 * (np.cos(angles)[:, None] * outward + np.sin(angles)[:, None] * [0.0, 0.0, 1.0])
    return [Ball((float(a), float(b), float(c)), 0.006) for a, b, c in arc]


def _find_hidden(
    nodes: Array, radius: float, depth: Array, intrinsics: Array, pose: Array
) -> NDArray[np.bool_]:
    """Return an (M,) mask of the nodes that are hidden or outside the image."""
    x, y, z = ((nodes - pose[:3, 3]) @ pose[:3, :3]).T
    columns = np.rint(intrinsics[0, 0] * x / z + intrinsics[0, 2]).astype(np.int64)
    rows = np.rint(intrinsics[1, 1] * y / z + intrinsics[1, 2]).astype(np.int64)
    inside = (rows >= 0) & (rows < depth.shape[0]) & (columns >= 0) & (columns < depth.shape[1])
    hidden = ~inside
    hidden[inside] = depth[rows[inside], columns[inside]] < z[inside] - 2.0 * radius
    return np.asarray(hidden)


def _is_shown(hidden: list[NDArray[np.bool_]]) -> bool:
    """Tell whether the views show enough of a rope, whose nodes are one radius apart."""
    if any(part[:_END_NODES].any() or part[-_END_NODES:].any() for part in hidden):
        return False
    if len(hidden) > 1:
        return not np.all(hidden, axis=0).any()
    steps = np.flatnonzero(np.diff(np.concatenate([[0], hidden[0].astype(np.int8), [0]])))
    return bool((np.diff(steps)[::2] <= _MAX_HIDDEN).all())


def _draw_tilt(rng: np.random.Generator) -> Array:
    """Return a random rigid motion from the table's frame to the world."""
    axis = rng.normal(size=3) * (1.0, 1.0, 0.0)
    angle = float(rng.uniform(0.0, _MAX_TILT))
    x, y, z = axis / np.linalg.norm(axis)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    motion = np.eye(4)
    motion[:3, :3] += math.sin(angle) * skew + (1.0 - math.cos(angle)) * (skew @ skew)
    motion[:3, 3] = rng.uniform(-_MAX_SHIFT, _MAX_SHIFT, 3)
    return motion
