"""Simulated scenes: depth images of ropes on a table, and the truth.

The same arguments give the same scene, bit for bit.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.support.checks import (
    Array,
    check_integer,
    check_positive,
    check_sequence,
    check_text,
    refuse_masks_and_units,
)
from strand.support.files import write_bytes
from strand.support.robust import estimate_deviation
from strand.synthetic.camera import Camera, find_device
from strand.synthetic.layout import Layout
from strand.synthetic.noise import DEFAULT_FLYING, Noise, make_plane_rotation, sense
from strand.synthetic.rendering import check_rope, render_depth
from strand.synthetic.segmentation import Segmentation
from strand.synthetic.shapes import LONGEST, default_length, lay_shape
from strand.views.view import View

_SQUEEZE = 0.03  # largest relative stretch of a shape's plan along one axis; it shrinks as much across
_SHIFT = 3.0  # radii: largest shift of a shape from the middle in x and in y
_MAX_VIEWS = 10_000  # images of a scene
_DEPTH_SD = 0.0007  # metres: default noise of a camera that imitates no device


@dataclass(frozen=True, eq=False)
class SyntheticScene:
    """Depth images of ropes, and the truth.

    Attributes
    ----------
    name : str
    depth : (V, H, W) ndarray of uint16
        Depth along the camera's z axis, in units of `depth_scale`; 0 for no return.
    depth_scale : float
        Metres per unit of depth.
    intrinsics : (3, 3) ndarray
        The pinhole matrix, pixels; integer coordinates are pixel centres.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses with errors in the table plane, as from a turntable.
    poses_true : (V, 4, 4) ndarray
        The true camera-to-world poses.
    bounds : pair of (3,) ndarray
        Low and high corner of the extraction range in the world frame, metres.
    radius : float
        The ropes' radius, metres; the mean of `radii` where they differ.
    truth : tuple of (M, 3) ndarray
        The ropes' true centrelines in the world frame, metres, from end to end.
    noise : float
        Standard deviation of the depths, metres. With an imitated device, it is a robust estimate from the
        errors of the ropes' pixels (1.4826 times the median absolute error), systematic errors included.
    mask : (V, H, W) ndarray of bool or int, or None
        The ropes' pixels, as in `View.from_depth`; None without masks.
    radii : tuple of float
        The radius of each rope, metres.
    stamps : tuple of float, or None
        When each image was taken, seconds.
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
    radii: tuple[float, ...] = ()
    stamps: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not self.radii:
            object.__setattr__(self, "radii", (self.radius,) * len(self.truth))

    @property
    def views(self) -> tuple[View, ...]:
        """The images as views, with `poses`."""
        nothing = [None] * len(self.depth)
        masks = nothing if self.mask is None else self.mask
        stamps = nothing if self.stamps is None else self.stamps
        return tuple(
            View.from_depth(
                image, self.intrinsics, pose, depth_scale=self.depth_scale, mask=mask, stamp=stamp
            )
            for image, pose, mask, stamp in zip(self.depth, self.poses, masks, stamps, strict=True)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an `.npz` file that `strand.load_scene` reads.

        The file also holds `poses_true`, `noise` and `radii` that differ. The centrelines have single
        precision. If writing fails, no partial file is left.

        Parameters
        ----------
        path : str or path-like
            The file to write or replace.

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
        if self.stamps is not None:
            arrays["stamps"] = np.array(self.stamps)
        if len(set(self.radii)) > 1:
            arrays["radii"] = np.array(self.radii)
        content = BytesIO()
        np.savez_compressed(content, **arrays)
        write_bytes(path, content.getvalue())


def scene(
    name: str | None = None,
    *,
    chains: Sequence[ArrayLike] | None = None,
    radius: float | Sequence[float] = 0.0042,
    length: float | None = None,
    seed: int = 0,
    views: int = 7,
    camera: Camera | None = None,
    noise: Noise | None = None,
    mask: Segmentation | None = None,
    layout: Layout | None = None,
) -> SyntheticScene:
    """Draw ropes on a table, seen by a depth camera from several sides.

    By default, the cameras look at the origin from 50 degrees above the table. Their azimuths are spread
    evenly from -90 to 90 degrees; a single camera is at 0. They stand 76 rope radii away, or farther where
    a view would otherwise cut a rope off.

    The seed turns, mirrors and shifts a named shape on the table and stretches its plan by up to 3 percent.
    It also draws the errors of depths, poses and masks.

    The bounds reach 6 radii beyond the ropes' axes. Without a mask, they cut the table away: in z they reach
    from 0.6 radii above the table to 3 radii above the highest axis.

    Parameters
    ----------
    name : str, optional
        One of `SHAPES`, "paper" by default. With `chains`, any name for the scene.
    chains : sequence of (M, 3) array_like of float, optional
        Ropes to show instead of a shape: nodes in the world frame, metres, about 1 mm apart, around the
        origin, at least a radius above the table.
    radius : float or sequence of float
        The ropes' radius, metres, or one of each chain.
    length : float, optional
        Length of a named shape, metres. By default it is proportional to the radius: 0.4 m for 4.2 mm, and
        0.72 m for "granny" and "square".
    seed : int
        Seed of the random numbers, not negative.
    views : int
        Number of images.
    camera : Camera, optional
        The image's size and unit, and the depth camera to imitate.
    noise : Noise, optional
        The errors of the depths and of the poses.
    mask : Segmentation, optional
        The errors of the masks. By default a scene has exact masks if its camera imitates a device, and
        none otherwise.
    layout : Layout, optional
        The cameras' distance and elevation, a wall instead of the table, and bars before the ropes.

    Returns
    -------
    SyntheticScene

    Raises
    ------
    TypeError
        If an argument has the wrong type, or a chain does not hold floating point numbers.
    ValueError
        If there is no such shape, `length` is too short for the shape or is given with `chains`, `chains` is
        empty or holds a rope that `render_depth` does not accept, the numbers of radii and of chains differ,
        `noise.flying` is given although the camera imitates a device, or a number is out of its range.

    Examples
    --------
    >>> from strand.synthetic import Camera, Noise, scene
    >>> made = scene("overhand", views=2, camera=Camera(size=(64, 48)), noise=Noise(depth=0.0003))
    >>> made.depth.shape
    (2, 48, 64)
    """
    chains = None if chains is None else check_sequence("chains", chains, "arrays")
    radius, radii = _check_radii(radius, chains)
    views = check_integer("views", views, 1, _MAX_VIEWS)
    camera, noise = _check_instance("camera", camera, Camera), _check_instance("noise", noise, Noise)
    layout = _check_instance("layout", layout, Layout)
    device = None if camera.device is None else find_device(camera.device)
    if device is not None and noise.flying is not None:
        raise ValueError("noise: expected no `flying` with a device, which mixes depths its own way")
    has_masks = device is not None or mask is not None
    mask = _check_instance("mask", mask, Segmentation)
    seeds = np.random.SeedSequence(check_integer("seed", seed, 0)).spawn(4)
    placing, stage, sensor, segmenter = (np.random.default_rng(child) for child in seeds)
    name, truth = _find_ropes(name, chains, radius, length, placing)
    nodes = np.concatenate(truth)
    poses, distance = layout.place_cameras(views, nodes, radius, camera.size)
    if device is not None and noise.depth is not None:
        device = device.with_noise(noise.depth, camera.focal_length, distance)
    depth_sd = _DEPTH_SD if noise.depth is None else noise.depth

    motion, side = layout.find_background(distance)
    ropes = [_move(chain, motion) for chain in truth]
    bars = [_move(np.asarray(line), motion) for line, _ in layout.bars]
    bar_radii = [bar_radius for _, bar_radius in layout.bars]
    images, masks, errors_on_ropes = [], [], []
    for pose in poses:
        seen_from = (camera.intrinsics, motion @ pose, camera.size, side)
        exact = render_depth([*ropes, *bars], [*(radii or [radius] * len(ropes)), *bar_radii], *seen_from)
        if device is None:
            image = sense(
                exact,
                noise=depth_sd,
                flying=DEFAULT_FLYING if noise.flying is None else noise.flying,
                step=radius,
                depth_scale=camera.depth_scale,
                rng=sensor,
            )
        else:
            image = device.sense(exact, camera.intrinsics, depth_scale=camera.depth_scale, rng=sensor)
        images.append(image)
        if has_masks:
            without_ropes = render_depth(bars, bar_radii, *seen_from)
            on_rope = (exact > 0) & ((exact < without_ropes) | (without_ropes == 0))
            masks.append(mask.make_mask(on_rope, segmenter))
            errors_on_ropes.append(np.abs(image * camera.depth_scale - exact)[on_rope & (image > 0)])
    if device is not None:
        depth_sd = estimate_deviation(np.concatenate(errors_on_ropes))
    low, high = nodes.min(axis=0) - 6.0 * radius, nodes.max(axis=0) + 6.0 * radius
    if layout.wall is None and not has_masks:
        low[2], high[2] = 0.6 * radius, nodes[:, 2].max() + 3.0 * radius
    return SyntheticScene(
        name=name,
        depth=np.stack(images),
        depth_scale=camera.depth_scale,
        intrinsics=camera.intrinsics,
        poses=noise.misplace(poses, stage),
        poses_true=poses,
        bounds=(low, high),
        radius=radius,
        truth=truth,
        noise=depth_sd,
        mask=np.stack(masks) if masks else None,
        radii=radii,
    )


def _check_radii(
    radius: float | Sequence[float], chains: Sequence[ArrayLike] | None
) -> tuple[float, tuple[float, ...]]:
    """Return the ropes' mean radius, metres, and that of each, or none where there is one for all."""
    refuse_masks_and_units("radius", radius)
    if isinstance(radius, np.ndarray) and radius.ndim == 0:
        radius = radius[()]
    if isinstance(radius, (str, bytes)) or not isinstance(radius, (Sequence, np.ndarray)):
        return check_positive("radius", radius, LONGEST), ()
    radii = tuple(check_positive(f"radius[{i}]", each, LONGEST) for i, each in enumerate(radius))
    if chains is None or len(radii) != len(chains):
        count = "none" if chains is None else len(chains)
        raise ValueError(f"radius: expected one number, or one for each chain ({count}), got {len(radii)}")
    return float(np.mean(radii)), radii


_Settings = TypeVar("_Settings")


def _check_instance(name: str, value: _Settings | None, kind: type[_Settings]) -> _Settings:
    """Return an argument that must have this type, or the type's default for None."""
    if value is not None and not isinstance(value, kind):
        raise TypeError(f"{name}: expected a {kind.__name__}, got {type(value).__name__}")
    return kind() if value is None else value


def _find_ropes(
    name: str | None,
    chains: Sequence[ArrayLike] | None,
    radius: float,
    length: float | None,
    rng: np.random.Generator,
) -> tuple[str, tuple[Array, ...]]:
    """Return a scene's name and the nodes of its ropes: a shape placed at random, or the given chains."""
    name = None if name is None else check_text("name", name)
    if chains is None:
        name = "paper" if name is None else name
        return name, (_place_shape(name, radius, length, rng),)
    if length is not None:
        raise ValueError("length: expected none along with chains, which have their own")
    ropes = tuple(check_rope(f"chains[{i}]", chain) for i, chain in enumerate(chains))
    if not ropes:
        raise ValueError("chains: expected at least one rope, got none")
    return "chains" if name is None else name, ropes


def _place_shape(name: str, radius: float, length: float | None, rng: np.random.Generator) -> Array:
    """Return the (M, 3) nodes of a shape, stretched, mirrored, turned and shifted at random."""
    turn, axis = rng.uniform(0.0, 2.0 * np.pi, size=2)
    stretch = math.exp(rng.uniform(-_SQUEEZE, _SQUEEZE))
    mirror = rng.choice([-1.0, 1.0])
    shift = rng.uniform(-_SHIFT, _SHIFT, size=2) * radius
    plane = make_plane_rotation(turn) @ np.diag([stretch, mirror / stretch]) @ make_plane_rotation(axis)
    nodes = lay_shape(
        name, radius, default_length(name) * radius / 0.0042 if length is None else length, plane
    )
    nodes[:, :2] += shift
    return nodes


def _move(nodes: Array, motion: Array) -> Array:
    return np.asarray(nodes @ motion[:3, :3].T + motion[:3, 3])
