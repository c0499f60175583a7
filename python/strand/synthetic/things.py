"""Things on a table that are no ropes, as a camera sees them: boxes, balls, mugs, posts."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.views.pinhole import Pinhole


@dataclass(frozen=True)
class Box:
    """A box that stands upright, turned about its own axis.

    Attributes
    ----------
    centre : (float, float, float)
        Metres.
    size : (float, float, float)
        Length, width and height, metres.
    turn : float
        Angle from the x axis to its length, radians.
    """

    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    turn: float = 0.0


@dataclass(frozen=True)
class Ball:
    """A ball.

    Attributes
    ----------
    centre : (float, float, float)
        Metres.
    radius : float
        Metres.
    """

    centre: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder: a post, or a mug if it is hollow.

    Attributes
    ----------
    base : (float, float, float)
        The middle of its bottom, metres.
    radius, height : float
        Metres.
    hollow : bool
        Open at its top, with a thin wall.
    """

    base: tuple[float, float, float]
    radius: float
    height: float
    hollow: bool = False


Thing = Box | Ball | Cylinder


def cast(depth: Array, things: list[Thing], intrinsics: Array, pose: Array) -> Array:
    """Return a depth image with things in it, where they are nearer than what is there.

    Parameters
    ----------
    depth : (H, W) ndarray
        Exact depths, metres; 0 where a ray hits nothing.
    things : list of Box, Ball or Cylinder
    intrinsics : (3, 3) ndarray
        The pinhole matrix, pixels.
    pose : (4, 4) ndarray
        Camera to world.

    Returns
    -------
    (H, W) ndarray
    """
    height, width = depth.shape
    rows, columns = np.mgrid[:height, :width]
    # rays reach z = 1 in the camera frame, so that the parameter along one is the depth
    rays = Pinhole.from_matrix(intrinsics).rays(rows, columns) @ pose[:3, :3].T
    found = np.where(depth > 0, depth, np.inf)
    for thing in things:
        found = np.minimum(found, _first(thing, pose[:3, 3], rays))
    return np.where(np.isfinite(found), found, 0.0)


def _first(thing: Thing, start: Array, rays: Array) -> Array:
    """(H, W) Where rays from a place first hit a thing; infinite where they do not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        match thing:
            case Box():
                return _first_of_box(thing, start, rays)
            case Ball():
                near, _ = _crossed(start - thing.centre, rays, thing.radius)
                return np.where(near > 0, near, np.inf)
            case Cylinder():
                return _first_of_cylinder(thing, start, rays)


def _first_of_box(box: Box, start: Array, rays: Array) -> Array:
    cosine, sine = math.cos(box.turn), math.sin(box.turn)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    origin, ways = turn @ (start - box.centre), rays @ turn.T
    half = 0.5 * np.array(box.size)
    low, high = (-half - origin) / ways, (half - origin) / ways
    enter, leave = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def _first_of_cylinder(cylinder: Cylinder, start: Array, rays: Array) -> Array:
    origin = start - cylinder.base
    near, far = _crossed(origin[:2], rays[..., :2], cylinder.radius)

    def on_side(t: Array) -> Array:
        z = origin[2] + t * rays[..., 2]
        return np.where((t > 0) & (z >= 0) & (z <= cylinder.height), t, np.inf)

    def on_disc(height: float) -> Array:
        t = (height - origin[2]) / rays[..., 2]
        away = origin[:2] + t[..., None] * rays[..., :2]
        return np.where((t > 0) & ((away**2).sum(axis=-1) <= cylinder.radius**2), t, np.inf)

    first = np.minimum(on_side(near), on_disc(0.0 if cylinder.hollow else cylinder.height))
    return np.minimum(first, on_side(far)) if cylinder.hollow else first


def _crossed(origin: Array, rays: Array, radius: float) -> tuple[Array, Array]:
    """Where rays enter and leave a ball or a disc about the origin; NaN where they miss it."""
    square, half = (rays**2).sum(axis=-1), rays @ origin
    root = np.sqrt(half**2 - square * (origin @ origin - radius**2))
    return (-half - root) / square, (-half + root) / square
