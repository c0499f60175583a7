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

from strand.checks import Array, not_negative, positive, several, whole
from strand.files import write_bytes
from strand.synthetic.camera import TABLE, camera_pose, image_size, render_depth, rope_nodes, sense
from strand.synthetic.shapes import LONGEST, lay
from strand.view import View

_FOCAL_LENGTH = 212.0 / 320.0  # of the image's width
_NEAREST = 76.0  # radii, from the camera to the middle: 0.32 m for a rope 8.4 mm thick
_BORDER = 0.02  # of the image's width and height: free of ropes
_SQUEEZE = 0.03  # largest stretch of a shape's plan along one axis, with as much squeeze across
_SHIFT = 3.0  # radii, largest shift of a shape from the middle in x and in y
_VIEWS = 10_000  # most images of a scene


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
        Standard deviation of the depths, metres.
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
    noise: float = 0.0007,
    views: int = 7,
    size: tuple[int, int] = (320, 240),
    depth_scale: float = 1e-4,
    flying: float = 0.05,
    turn_error: float = math.radians(0.5),
    shift_error: float = 0.0015,
) -> SyntheticScene:
    """Ropes on a table, seen by a depth camera that is moved around it.

    The camera looks at the origin from 50 degrees above the table, from azimuths spread evenly over
    -90 to 90 degrees (a single view: from 0), at the least distance, but not under 76 radii, at which
    every view holds the ropes whole. The seed turns, mirrors and shifts a named shape on the table,
    stretches its plan by up to 3 percent, and draws the depths' noise, the flying pixels and the errors
    of the poses. The extraction range leaves 6 radii around the ropes' axes in x and y, and goes from
    0.6 radii above the table to 3 radii above the highest axis.

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
        A named shape's length, metres; if not given, in proportion to the radius: 0.4 m for 4.2 mm.
    noise : float
        Standard deviation of the depths, metres.
    views : int
        How many images.
    size : (int, int)
        Width and height of an image, pixels; the focal length grows with the width.
    depth_scale : float
        Metres for each unit of depth.
    flying : float
        Part, from 0 to 1, of the pixels next to a step in depth that get a depth between the two.
    turn_error, shift_error : float
        Standard deviation of the poses' errors as read off the stage: of a turn about the world's z
        axis, radians, and of shifts along x and y, metres. The middle view's pose is exact.

    Returns
    -------
    SyntheticScene

    Raises
    ------
    TypeError
        If an argument is not a number or an integer where it should be, or a chain does not hold
        floating point numbers.
    ValueError
        If there is no such shape, `length` is too short for it or is given along with `chains`,
        there are no chains or one is not as `render_depth` wants it, `views` is not positive, or a
        number is out of its range.
    """
    if name is not None and not isinstance(name, str):
        raise TypeError(f"name: expected text, got {type(name).__name__}")
    radius = positive("radius", radius, LONGEST)
    noise = not_negative("noise", noise)
    turn_error, shift_error = (
        not_negative("turn_error", turn_error),
        not_negative("shift_error", shift_error),
    )
    count, (width, height) = whole("views", views, 1, _VIEWS), image_size(size)
    placing, stage, sensor = (
        np.random.default_rng(child) for child in np.random.SeedSequence(whole("seed", seed, 0)).spawn(3)
    )
    if chains is None:
        name = "paper" if name is None else name
        truth: tuple[Array, ...] = (_placed(name, radius, length, placing),)
    else:
        if length is not None:
            raise ValueError("length: expected none along with chains, which have their own")
        name = "chains" if name is None else name
        shown = several("chains", chains, "arrays")
        truth = tuple(rope_nodes(f"chains[{i}]", chain) for i, chain in enumerate(shown))
        if not truth:
            raise ValueError("chains: expected at least one rope, got none")

    azimuths = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count) if count > 1 else np.zeros(1)
    focus, centre = _FOCAL_LENGTH * width, (0.5 * (width - 1), 0.5 * (height - 1))
    intrinsics = np.array([[focus, 0.0, centre[0]], [0.0, focus, centre[1]], [0.0, 0.0, 1.0]])
    nodes = np.concatenate(truth)
    half_view = (0.5 - _BORDER) * np.array([width, height]) / focus
    distance = max(_NEAREST * radius, *(_fitting_distance(nodes, radius, a, half_view) for a in azimuths))
    poses_true = np.stack([camera_pose(azimuth, distance) for azimuth in azimuths])
    table = max(TABLE, 3.0 * distance)
    depth = np.stack(
        [
            sense(
                render_depth(truth, radius, intrinsics, pose, (width, height), table),
                noise=noise,
                flying=flying,
                step=radius,
                depth_scale=depth_scale,
                rng=sensor,
            )
            for pose in poses_true
        ]
    )
    errors = stage.normal(size=(count, 3)) * (turn_error, shift_error, shift_error)
    errors[count // 2] = 0.0
    low, high = nodes.min(axis=0) - 6.0 * radius, nodes.max(axis=0) + 6.0 * radius
    low[2], high[2] = 0.6 * radius, nodes[:, 2].max() + 3.0 * radius
    return SyntheticScene(
        name=name,
        depth=depth,
        depth_scale=float(depth_scale),
        intrinsics=intrinsics,
        poses=np.stack([_moved(pose, *error) for pose, error in zip(poses_true, errors, strict=True)]),
        poses_true=poses_true,
        bounds=(low, high),
        radius=radius,
        truth=truth,
        noise=noise,
    )


def _placed(name: str, radius: float, length: float | None, rng: np.random.Generator) -> Array:
    """(M, 3) A shape, stretched, mirrored, turned and shifted by chance."""
    turn, axis = rng.uniform(0.0, 2.0 * np.pi, size=2)
    stretch = math.exp(rng.uniform(-_SQUEEZE, _SQUEEZE))
    mirror = rng.choice([-1.0, 1.0])
    shift = rng.uniform(-_SHIFT, _SHIFT, size=2) * radius
    plane = _turn(turn) @ np.diag([stretch, mirror / stretch]) @ _turn(axis)
    nodes = lay(name, radius, 0.4 * radius / 0.0042 if length is None else length, plane)
    nodes[:, :2] += shift
    return nodes


def _turn(angle: float) -> Array:
    """(2, 2) Rotation in the plane."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def _moved(pose: Array, angle: float, dx: float, dy: float) -> Array:
    """(4, 4) The pose turned about the world's z axis, then shifted in the table plane."""
    motion = np.eye(4)
    motion[:2, :2] = _turn(angle)
    motion[:2, 3] = dx, dy
    return np.asarray(motion @ pose)


def _fitting_distance(nodes: Array, radius: float, azimuth: float, half_view: Array) -> float:
    """Least distance from the origin at which a camera sees every node, with a radius around it.

    `half_view` is x / z and y / z at the borders of the image.
    """
    seen = nodes @ camera_pose(azimuth, 1.0)[:3, :3]  # but for the distance, which adds to z
    return float(((np.abs(seen[:, :2]) + radius) / half_view - seen[:, 2:]).max())
