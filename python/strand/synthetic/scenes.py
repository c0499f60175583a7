"""Simulated scenes: ropes on a table, seen from several sides, with the truth about them.

A scene is drawn from a seed: the same arguments give the same scene, bit for bit.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.support.checks import (
    Array,
    check_integer,
    check_nonnegative,
    check_number,
    check_positive,
    check_sequence,
)
from strand.support.files import write_bytes
from strand.support.robust import robust_deviation
from strand.synthetic.camera import TABLE, camera_pose, image_size, render_depth, rope_nodes, sense
from strand.synthetic.depth_camera import CAMERAS, DepthCamera
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.shapes import LONGEST, lay, usual_length
from strand.views.view import View

FOCAL_LENGTH = 212.0 / 320.0
"""Focal length of a scene's cameras, of the image's width."""

_NEAREST = 76.0  # radii, from the camera to the middle: 0.32 m for a rope 8.4 mm thick
_BORDER = 0.02  # of the image's width and height: free of ropes
_SQUEEZE = 0.03  # largest stretch of a shape's plan along one axis, with as much squeeze across
_SHIFT = 3.0  # radii, largest shift of a shape from the middle in x and in y
_VIEWS = 10_000  # most images of a scene
_NOISE, _FLYING = 0.0007, 0.05  # of a scene without a camera: metres, and a part of the pixels at steps
_ELEVATION = math.radians(50.0)  # of the cameras above a table
_AROUND_TABLE, _BEFORE_WALL = math.radians(90.0), math.radians(40.0)  # the outermost azimuths


@dataclass(frozen=True, eq=False)
class SyntheticScene:
    """Depth images of ropes on a table, and the truth about them.

    Attributes
    ----------
    name : str
        What to call it.
    depth : (V, H, W) ndarray of uint16
        Depth along the camera's z axis in units of `depth_scale`; 0 for no return.
    depth_scale : float
        Metres for each unit of depth.
    intrinsics : (3, 3) ndarray
        The pinhole matrix, pixels; an integer pixel is a pixel centre.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses as read off the stage, a little wrong in the table plane.
    poses_true : (V, 4, 4) ndarray
        The poses that the images were taken from.
    bounds : pair of (3,) ndarray
        Low and high corner of the extraction range in the world frame, metres: cuts the table away.
    radius : float
        The ropes' radius, metres.
    truth : tuple of (M, 3) ndarray
        The ropes' centrelines in the world frame, metres, end to end.
    noise : float
        Standard deviation of the depths, metres; of an imitated camera a robust one (1.4826 times the median
        absolute error) over the ropes' pixels, with all that is systematic.
    mask : (V, H, W) ndarray of bool or int, or None
        The ropes' pixels as a segmenter gives them, as `View.from_depth` takes them; None: not known.
    """

    name: str
    depth: NDArray[np.uint16]
    depth_scale: float
    intrinsics: Array
    poses: Array
    poses_true: Array
    bounds: tuple[Array, Array]
    radius: float
    truth: tuple[Array, ...]
    noise: float
    mask: NDArray[np.bool_] | NDArray[np.integer[Any]] | None = None

    @property
    def views(self) -> tuple[View, ...]:
        """The images as views, with the poses as read off the stage."""
        masks = [None] * len(self.depth) if self.mask is None else self.mask
        return tuple(
            View.from_depth(image, self.intrinsics, pose, depth_scale=self.depth_scale, mask=mask)
            for image, pose, mask in zip(self.depth, self.poses, masks, strict=True)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an `.npz` file that `strand.load_scene` reads, whole or not at all.

        Besides what that reads it holds `poses_true` and `noise`. The centrelines are written in
        single precision.

        Parameters
        ----------
        path : str or path-like
            The file; one that exists is replaced.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        arrays: dict[str, Any] = {
            "depth": self.depth,
            "depth_scale": self.depth_scale,
            "K": self.intrinsics,
            "poses": self.poses,
            "poses_true": self.poses_true,
            "box": np.stack(self.bounds),
            "radius": self.radius,
            "noise": self.noise,
            "name": self.name,
        }
        for i, nodes in enumerate(self.truth):
            arrays[f"truth_{i}"] = nodes.astype(np.float32)
        if self.mask is not None:
            arrays["mask"] = self.mask
        content = BytesIO()
        np.savez_compressed(content, **arrays)
        write_bytes(path, content.getvalue())


def scene(
    name: str | None = None,
    *,
    chains: Sequence[ArrayLike] | None = None,
    seed: int = 0,
    radius: float = 0.0042,
    length: float | None = None,
    noise: float | None = None,
    views: int = 7,
    size: tuple[int, int] = (320, 240),
    depth_scale: float = 1e-4,
    flying: float | None = None,
    turn_error: float = math.radians(0.5),
    shift_error: float = 0.0015,
    camera: str | DepthCamera | None = None,
    mask: Segmentation | None = None,
    distance: float | None = None,
    elevation: float | None = None,
    wall: float | None = None,
    bars: Sequence[tuple[ArrayLike, float]] = (),
) -> SyntheticScene:
    """Ropes on a table, seen by a depth camera that is moved around it.

    The camera looks at the origin from 50 degrees above the table, from azimuths spread evenly over
    -90 to 90 degrees (a single view: from 0), at the least distance, but not under 76 radii, at which
    every view holds the ropes whole. The seed turns, mirrors and shifts a named shape on the table,
    stretches its plan by up to 3 percent, and draws the depths' noise, the flying pixels and the errors
    of the poses. The extraction range leaves 6 radii around the ropes' axes in x and y, and goes from
    0.6 radii above the table to 3 radii above the highest axis; with a mask, which needs no cut at the
    table, and before a wall it leaves 6 radii in z too.

    Without a `camera` errors are normal and independent. An imitated one has wide, correlated errors, and
    the scene a mask.

    Parameters
    ----------
    name : str, optional
        One of `SHAPES`, "paper" if not given; with `chains`, only what to call the scene.
    chains : sequence of (M, 3) array_like of float, optional
        Ropes to show as they are, instead of a shape: nodes in the world frame, metres, about 1 mm
        apart, around the origin, at least a radius above the table.
    seed : int
        The source of chance, not negative.
    radius : float
        The ropes' radius, metres.
    length : float, optional
        A named shape's length, metres; if not given, in proportion to the radius: 0.4 m for 4.2 mm, 0.72 m of
        "granny" and "square".
    noise : float, optional
        Standard deviation of the depths, metres; 0.7 mm if not given. With a camera, at its distance from
        the origin, and the camera's own if not given.
    views : int
        How many images.
    size : (int, int)
        Width and height of an image, pixels; the focal length grows with the width.
    depth_scale : float
        Metres for each unit of depth.
    flying : float, optional
        Part, from 0 to 1, of the pixels next to a step in depth that get a depth between the two; 0.05
        if not given, and none with a camera.
    turn_error, shift_error : float
        Standard deviation of the poses' errors as read off the stage: of a turn about the world's z
        axis, radians, and of shifts along x and y, metres. The middle view's pose is exact.
    camera : str or DepthCamera, optional
        A key of `CAMERAS`, or a camera of your own.
    mask : Segmentation, optional
        How the ropes' pixels are found; exactly if not given along with a camera.
    distance : float, optional
        From the origin to the cameras, metres, if every view holds the ropes whole from there; 76 radii if
        not given.
    elevation : float, optional
        Angle of the cameras above the table, radians; 50 degrees if not given, 0 before a wall.
    wall : float, optional
        Instead of a table, a wall at x = -wall, metres: for ropes that hang. The cameras look along -x, from
        azimuths of -40 to 40 degrees.
    bars : sequence of ((M, 3) array_like, float)
        Round bars in the way that are no ropes: nodes and radius, metres.

    Returns
    -------
    SyntheticScene

    Raises
    ------
    TypeError
        If an argument is not a number or an integer where it should be, or a chain does not hold
        floating point numbers.
    ValueError
        If there is no such shape or camera, `length` is too short for the shape or is given along with
        `chains`, there are no chains or one is not as `render_depth` wants it, `views` is not positive,
        `flying` is given along with a camera, or a number is out of its range.
    """
    if name is not None and not isinstance(name, str):
        raise TypeError(f"name: expected text, got {type(name).__name__}")
    radius = check_positive("radius", radius, LONGEST)
    noise = None if noise is None else check_nonnegative("noise", noise)
    turn_error, shift_error = (
        check_nonnegative("turn_error", turn_error),
        check_nonnegative("shift_error", shift_error),
    )
    imitated = imitated_camera(camera)
    if imitated is not None and flying is not None:
        raise ValueError("flying: expected none along with a camera, which mixes depths its own way")
    if mask is not None and not isinstance(mask, Segmentation):
        raise TypeError(f"mask: expected a Segmentation, got {type(mask).__name__}")
    wall = None if wall is None else check_positive("wall", wall, LONGEST)
    count, (width, height) = check_integer("views", views, 1, _VIEWS), image_size(size)
    placing, stage, sensor, segmenter = (
        np.random.default_rng(child)
        for child in np.random.SeedSequence(check_integer("seed", seed, 0)).spawn(4)
    )
    if chains is None:
        name = "paper" if name is None else name
        truth: tuple[Array, ...] = (_placed(name, radius, length, placing),)
    else:
        if length is not None:
            raise ValueError("length: expected none along with chains, which have their own")
        name = "chains" if name is None else name
        given = check_sequence("chains", chains, "arrays")
        truth = tuple(rope_nodes(f"chains[{i}]", chain) for i, chain in enumerate(given))
        if not truth:
            raise ValueError("chains: expected at least one rope, got none")
    obstacles = [_obstacle(f"bars[{i}]", bar) for i, bar in enumerate(check_sequence("bars", bars, "pairs"))]

    if elevation is None:
        elevation = _ELEVATION if wall is None else 0.0
    around = azimuths(count, wall is not None)
    focus, centre = FOCAL_LENGTH * width, (0.5 * (width - 1), 0.5 * (height - 1))
    intrinsics = np.array([[focus, 0.0, centre[0]], [0.0, focus, centre[1]], [0.0, 0.0, 1.0]])
    nodes = np.concatenate(truth)
    least = nearest(nodes, radius, around, check_number("elevation", elevation), (width, height))
    distance = max(
        _NEAREST * radius if distance is None else check_positive("distance", distance, LONGEST), least
    )
    poses_true = np.stack([camera_pose(azimuth, distance, elevation) for azimuth in around])
    if imitated is not None and noise is not None:
        imitated = imitated.with_noise(noise, focus, distance)
    if wall is None:
        frame, side = np.eye(4), max(TABLE, 3.0 * distance)
    else:
        frame, side = _wall_frame(wall), 4.0 * (distance + wall)
    ropes, others = (
        [nodes @ frame[:3, :3].T + frame[:3, 3] for nodes in lines]
        for lines in (truth, [bar for bar, _ in obstacles])
    )
    bar_radii = [bar_radius for _, bar_radius in obstacles]
    images, masks, on_ropes = [], [], []
    for pose in poses_true:
        seen_from = (intrinsics, frame @ pose, (width, height), side)
        exact = render_depth([*ropes, *others], [radius] * len(ropes) + bar_radii, *seen_from)
        if imitated is None:
            image = sense(
                exact,
                noise=_NOISE if noise is None else noise,
                flying=_FLYING if flying is None else flying,
                step=radius,
                depth_scale=depth_scale,
                rng=sensor,
            )
        else:
            image = imitated.sense(exact, intrinsics, depth_scale=depth_scale, rng=sensor)
        images.append(image)
        if imitated is not None or mask is not None:
            empty = render_depth(others, bar_radii, *seen_from)
            shown = (exact > 0) & ((exact < empty) | (empty == 0))
            masks.append((mask or Segmentation()).find(shown, segmenter))
            on_ropes.append(np.abs(image * depth_scale - exact)[shown & (image > 0)])
    if imitated is not None:
        found = np.concatenate(on_ropes)
        noise = robust_deviation(found)
    errors = stage.normal(size=(count, 3)) * (turn_error, shift_error, shift_error)
    errors[count // 2] = 0.0
    low, high = nodes.min(axis=0) - 6.0 * radius, nodes.max(axis=0) + 6.0 * radius
    if wall is None and not masks:
        low[2], high[2] = 0.6 * radius, nodes[:, 2].max() + 3.0 * radius
    return SyntheticScene(
        name=name,
        depth=np.stack(images),
        depth_scale=float(depth_scale),
        intrinsics=intrinsics,
        poses=np.stack([misplaced(pose, *error) for pose, error in zip(poses_true, errors, strict=True)]),
        poses_true=poses_true,
        bounds=(low, high),
        radius=radius,
        truth=truth,
        noise=_NOISE if noise is None else noise,
        mask=np.stack(masks) if masks else None,
    )


def _obstacle(name: str, bar: tuple[ArrayLike, float]) -> tuple[Array, float]:
    if not isinstance(bar, (tuple, list)) or len(bar) != 2:
        raise ValueError(f"{name}: expected a pair of nodes and a radius")
    return rope_nodes(name, bar[0]), check_positive(name, bar[1], LONGEST)


def imitated_camera(camera: str | DepthCamera | None) -> DepthCamera | None:
    """Return the camera of a name, or the one that was given; None for none."""
    if camera is None or isinstance(camera, DepthCamera):
        return camera
    if not isinstance(camera, str):
        raise TypeError(f"camera: expected a name or a DepthCamera, got {type(camera).__name__}")
    if camera not in CAMERAS:
        raise ValueError(f"camera: expected one of {', '.join(CAMERAS)}, got {camera!r}")
    return CAMERAS[camera]


def _placed(name: str, radius: float, length: float | None, rng: np.random.Generator) -> Array:
    """(M, 3) A shape, stretched, mirrored, turned and shifted by chance."""
    turn, axis = rng.uniform(0.0, 2.0 * np.pi, size=2)
    stretch = math.exp(rng.uniform(-_SQUEEZE, _SQUEEZE))
    mirror = rng.choice([-1.0, 1.0])
    shift = rng.uniform(-_SHIFT, _SHIFT, size=2) * radius
    plane = turned(turn) @ np.diag([stretch, mirror / stretch]) @ turned(axis)
    nodes = lay(name, radius, usual_length(name) * radius / 0.0042 if length is None else length, plane)
    nodes[:, :2] += shift
    return nodes


def turned(angle: float) -> Array:
    """(2, 2) Rotation in the plane."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def misplaced(pose: Array, angle: float, dx: float, dy: float) -> Array:
    """(4, 4) The pose turned about the world's z axis, then shifted in the table plane."""
    motion = np.eye(4)
    motion[:2, :2] = turned(angle)
    motion[:2, 3] = dx, dy
    return np.asarray(motion @ pose)


def _wall_frame(wall: float) -> Array:
    """(4, 4) Motion that takes the plane x = -wall to z = 0, and what is before it above that."""
    motion = np.eye(4)
    motion[:3, :3] = np.roll(np.eye(3), 1, axis=1)
    motion[2, 3] = wall
    return motion


def azimuths(views: int, before_wall: bool = False) -> Array:
    """(V,) Azimuths of a scene's cameras, radians: all around a table's half, or before a wall."""
    outermost = _BEFORE_WALL if before_wall else _AROUND_TABLE
    return np.linspace(-outermost, outermost, views) if views > 1 else np.zeros(1)


def nearest(nodes: Array, radius: float, around: Array, elevation: float, size: tuple[int, int]) -> float:
    """Least distance from the origin at which a scene's cameras see every node, with a radius around it.

    `around` has the cameras' azimuths; nodes are in metres, angles in radians, the size in pixels.
    """
    half_view = (0.5 - _BORDER) * np.array(size) / (FOCAL_LENGTH * size[0])
    # nodes as cameras see them, but for the distance, which adds to z
    seen = [nodes @ camera_pose(azimuth, 1.0, elevation)[:3, :3] for azimuth in around]
    return max(float(((np.abs(v[:, :2]) + radius) / half_view - v[:, 2:]).max()) for v in seen)
