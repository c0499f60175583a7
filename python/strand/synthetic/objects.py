"""Objects on a table that are not ropes: boxes, balls, mugs and posts, drawn into depth images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.views.pinhole import Pinhole


@dataclass(frozen=True)
class Box:
    """An upright box.

    Attributes
    ----------
    center : (float, float, float)
        Metres.
    size : (float, float, float)
        Length, width and height, metres.
    turn : float
        Angle from the x axis to its length, about the z axis, radians.
    """

    center: tuple[float, float, float]
    size: tuple[float, float, float]
    turn: float = 0.0


@dataclass(frozen=True)
class Ball:
    """A ball.

    Attributes
    ----------
    center : (float, float, float)
        Metres.
    radius : float
        Metres.
    """

    center: tuple[float, float, float]
    radius: float


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder: a post, or a mug if it is hollow.

    Attributes
    ----------
    base : (float, float, float)
        Centre of its bottom, metres.
    radius, height : float
        Metres.
    hollow : bool
        Whether it is open at the top, with a thin wall.
    """

    base: tuple[float, float, float]
    radius: float
    height: float
    hollow: bool = False


Object = Box | Ball | Cylinder


def add_objects(depth: Array, objects: list[Object], intrinsics: Array, pose: Array) -> Array:
    """Return a depth image with objects, where they are nearer than its depths.

    Parameters
    ----------
    depth : (H, W) ndarray
        Exact depths, metres; 0 where a ray hits nothing.
    objects : list of Box, Ball or Cylinder
    intrinsics : (3, 3) ndarray
        The pinhole matrix, pixels.
    pose : (4, 4) ndarray
        Camera-to-world rigid motion.

    Returns
    -------
    (H, W) ndarray
    """
    height, width = depth.shape
    rows, columns = np.mgrid[:height, :width]
    # at z = 1 in the camera frame, so that the parameter along a ray is the depth
    rays = Pinhole.from_matrix(intrinsics).cast_rays(rows, columns) @ pose[:3, :3].T
    nearest = np.where(depth > 0, depth, np.inf)
    for item in objects:
        nearest = np.minimum(nearest, cast_rays(item, pose[:3, 3], rays))
    return np.where(np.isfinite(nearest), nearest, 0.0)


def cast_rays(item: Object, start: Array, rays: Array) -> Array:
    """Return the (...) parameters at which rays (..., 3) first hit an object; infinite where they miss it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        match item:
            case Box():
                return _cast_box(item, start, rays)
            case Ball():
                near, _ = _intersect_sphere(start - item.center, rays, item.radius)
                return np.where(near > 0, near, np.inf)
            case Cylinder():
                return _cast_cylinder(item, start, rays)


def _cast_box(box: Box, start: Array, rays: Array) -> Array:
    cosine, sine = math.cos(box.turn), math.sin(box.turn)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    origin, ways = turn @ (start - box.center), rays @ turn.T
    half = 0.5 * np.array(box.size)
    low, high = (-half - origin) / ways, (half - origin) / ways
    enter, leave = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


def _cast_cylinder(cylinder: Cylinder, start: Array, rays: Array) -> Array:
    origin = start - cylinder.base
    near, far = _intersect_sphere(origin[:2], rays[..., :2], cylinder.radius)

    def hit_side(t: Array) -> Array:
        z = origin[2] + t * rays[..., 2]
        return np.where((t > 0) & (z >= 0) & (z <= cylinder.height), t, np.inf)

    def hit_disc(height: float) -> Array:
        t = (height - origin[2]) / rays[..., 2]
        away = origin[:2] + t[..., None] * rays[..., :2]
        return np.where((t > 0) & ((away**2).sum(axis=-1) <= cylinder.radius**2), t, np.inf)

    first = np.minimum(hit_side(near), hit_disc(0.0 if cylinder.hollow else cylinder.height))
    return np.minimum(first, hit_side(far)) if cylinder.hollow else first


def _intersect_sphere(origin: Array, rays: Array, radius: float) -> tuple[Array, Array]:
    """Return where rays enter and leave a ball or a disc around the origin; NaN where they miss it."""
    square, half = (rays**2).sum(axis=-1), rays @ origin
    root = np.sqrt(half**2 - square * (origin @ origin - radius**2))
    return (-half - root) / square, (-half + root) / square
