"""A simulated depth camera that looks at strings on a table: views with known true centrelines.

For users without a camera, and for demonstrations, tests and benches. A scene is drawn from a seed:
the same arguments give the same scene, bit for bit.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand import io
from strand.arguments import not_negative, number, positive, several, whole
from strand.shapes import LONGEST, SHAPES, lay, shape
from strand.tangles import tangle
from strand.view import Array, View, finite_array, rigid_motion

__all__ = ["SHAPES", "SyntheticScene", "camera_pose", "render_depth", "scene", "sense", "shape", "tangle"]

_TABLE = 1.0  # metres, side of the table
_ELEVATION = math.radians(50.0)  # of the camera above the table, seen from the middle
_FOCAL_LENGTH = 212.0 / 320.0  # of the image's width
_NEAREST = 76.0  # radii, from the camera to the middle: 0.32 m for a string 8.4 mm thick
_BORDER = 0.02  # of the image's width and height: free of strings
_SQUEEZE = 0.03  # largest stretch of a shape's plan along one axis, with as much squeeze across
_SHIFT = 3.0  # radii, largest shift of a shape from the middle in x and in y
_VIEWS = 10_000  # most images of a scene
_LOT = 1 << 18  # pairs of a piece of tube and a pixel at a time: bounds the memory

_Indices = NDArray[np.int64]


def render_depth(
    chains: Sequence[ArrayLike],
    radius: float | Sequence[float],
    intrinsics: ArrayLike,
    pose: ArrayLike,
    size: tuple[int, int] = (320, 240),
    table: float = True,
) -> Array:
    """Depth image of strings on a table, by casting a ray through every pixel's centre.

    A string is a round tube about the straight segments between its nodes, mitred at the nodes and
    cut flat at its two ends; a ray hits it from outside only. Bends of the axis whose radius is not
    above the string's are drawn wrongly.

    Parameters
    ----------
    chains : sequence of (M, 3) array_like of float
        The strings' nodes in the world frame, metres, end to end.
    radius : float or sequence of float
        The strings' radius, metres, or one for each.
    intrinsics : (3, 3) array_like of float
        The pinhole matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
    pose : (4, 4) array_like of float
        Camera-to-world rigid motion; the camera frame is x right, y down, z forward.
    size : (int, int)
        Width and height of the image, pixels.
    table : float
        Side of the table, metres: a square about the origin of the plane z = 0. True stands for 1 m,
        False or 0 for no table.

    Returns
    -------
    (H, W) ndarray
        Depth along the camera's z axis, metres; 0 where a ray hits nothing. An integer pixel is a
        pixel centre.

    Raises
    ------
    TypeError
        If an array does not hold floating point numbers, a radius is not a number, or `size` does not
        hold integers.
    ValueError
        If a chain is not (M, 3) with M >= 2, is not finite, has equal neighbours or turns by 90 degrees
        or more at a node; if a radius is not positive or there is not one for each chain; if the
        intrinsics are not a pinhole's, `pose` is not a rigid motion, `size` is not two positive
        numbers, or `table` is negative or not finite.
    """
    tubes = [_nodes(f"chains[{i}]", chain) for i, chain in enumerate(several("chains", chains, "arrays"))]
    radii = _radii(radius, len(tubes))
    camera = finite_array("intrinsics", intrinsics, (3, 3))
    fx, fy, cx, cy = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]
    if fx <= 0 or fy <= 0 or not np.array_equal(camera, [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]):
        raise ValueError(
            "intrinsics: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0, "
            f"got {camera.tolist()}"
        )
    motion = rigid_motion("pose", pose)
    width, height = _image_size(size)
    side = float(table) * _TABLE if isinstance(table, bool) else not_negative("table", table)

    rotation, centre = motion[:3, :3], motion[:3, 3]
    # rays reach z = 1 in the camera frame, so that the parameter along one is the depth
    x, y = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
    depth = np.full((height, width), np.inf)
    if side > 0:
        ray = [rotation[k, 0] * x + (rotation[k, 1] * y + rotation[k, 2])[:, None] for k in range(3)]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -centre[2] / ray[2]
            hit = (t > 0) & (np.abs(centre[0] + t * ray[0]) <= 0.5 * side)
            hit &= np.abs(centre[1] + t * ray[1]) <= 0.5 * side
        depth[hit] = t[hit]
    for nodes, tube_radius in zip(tubes, radii, strict=True):
        _cast_tube(depth, x, y, (nodes - centre) @ rotation, tube_radius)
    depth[np.isinf(depth)] = 0.0
    return depth


def _cast_tube(depth: Array, x: Array, y: Array, nodes: Array, radius: float) -> None:
    """Lower `depth` to the tube about `nodes`, where that is nearer.

    `depth` is (H, W); `x` (W,) and `y` (H,) are the directions of the columns' and rows' rays at z = 1;
    `nodes` are in the camera frame.
    """
    axes = np.diff(nodes, axis=0)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    # two pieces meet in the plane that halves the angle between them
    cuts = np.vstack([axes[:1], axes[:-1] + axes[1:], axes[-1:]])
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    begin, end = (nodes[:-1] * cuts[:-1]).sum(axis=1), (nodes[1:] * cuts[1:]).sum(axis=1)
    rims = radius / np.concatenate([(cuts[:-1] * axes).sum(axis=1), [1.0]])
    low, high = _pixel_boxes(x, y, nodes, rims)
    low, high = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
    ahead = nodes[:, 2] + rims > 0
    high[~(ahead[:-1] | ahead[1:])] = 0

    start = nodes[:-1]
    along = (start * axes).sum(axis=1)
    excess = (start * start).sum(axis=1) - along**2 - radius**2
    image, slack = depth.reshape(-1), 1e-9 * radius
    for i, u, v in _pixels(low, high):
        ray = np.stack([x[u], y[v], np.ones(len(u))], axis=1)
        # the ray is at the radius from the axis at two depths, of which the first is outside
        slope = _dot(axes[i], ray)
        square = _dot(ray, ray) - slope * slope
        half = _dot(start[i], ray) - slope * along[i]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (half - np.sqrt(half * half - square * excess[i])) / square
            hit = (t > 0) & (t * _dot(cuts[i], ray) >= begin[i] - slack)
            hit &= t * _dot(cuts[i + 1], ray) <= end[i] + slack
        np.minimum.at(image, (v * len(x) + u)[hit], t[hit])

    for node, outward in ((nodes[:1], -axes[0]), (nodes[-1:], axes[-1])):
        (low,), (high,) = _pixel_boxes(x, y, node, np.array([radius]))
        columns, rows = slice(low[0], high[0]), slice(low[1], high[1])
        across, down = x[columns], y[rows, None]
        facing = outward[0] * across + outward[1] * down + outward[2]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = node[0] @ outward / facing
            off = (t * across - node[0, 0]) ** 2 + (t * down - node[0, 1]) ** 2 + (t - node[0, 2]) ** 2
        hit = (facing < 0) & (t > 0) & (off <= radius**2)
        depth[rows, columns][hit] = np.minimum(depth[rows, columns], t)[hit]


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


def _pixel_boxes(x: Array, y: Array, centres: Array, radii: Array) -> tuple[_Indices, _Indices]:
    """First column and row, and those after the last, that can see balls: two (N, 2) arrays.

    A ball that reaches beside or behind the camera may be anywhere in the image.
    """
    near, far = centres[:, 2] - radii, centres[:, 2] + radii
    low, high = np.zeros((len(centres), 2), dtype=np.int64), np.empty((len(centres), 2), dtype=np.int64)
    for k, directions in enumerate((x, y)):
        before, after = centres[:, k] - radii, centres[:, k] + radii
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = np.minimum(before / near, before / far), np.maximum(after / near, after / far)
        low[:, k] = np.where(near > 0, np.searchsorted(directions, first, side="left"), 0)
        high[:, k] = np.where(near > 0, np.searchsorted(directions, last, side="right"), len(directions))
    return low, high


def _pixels(low: _Indices, high: _Indices) -> Iterator[tuple[_Indices, _Indices, _Indices]]:
    """Yield box, column and row of every pixel of every box, many boxes at a time."""
    columns, rows = np.clip(high - low, 0, None).T
    counts = columns * rows
    ends = np.cumsum(counts)
    first = 0
    while first < len(counts):
        done = ends[first] - counts[first]
        last = max(first + 1, int(np.searchsorted(ends, done + _LOT, side="right")))
        box = np.repeat(np.arange(first, last), counts[first:last])
        within = done + np.arange(len(box)) - (ends - counts)[box]
        yield box, low[box, 0] + within % columns[box], low[box, 1] + within // columns[box]
        first = last


def camera_pose(azimuth: float, distance: float, elevation: float = _ELEVATION) -> Array:
    """Camera-to-world pose of a camera that looks at the origin, upright.

    Parameters
    ----------
    azimuth : float
        Angle about the world's z axis from the x axis to the camera, radians.
    distance : float
        From the origin to the camera's centre, metres.
    elevation : float
        Angle of the camera above the table z = 0, radians.

    Returns
    -------
    (4, 4) ndarray

    Raises
    ------
    TypeError
        If an argument is not a number.
    ValueError
        If an angle is not finite or `distance` is not positive.
    """
    azimuth, elevation = number("azimuth", azimuth), number("elevation", elevation)
    outward = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(right, outward), -outward], axis=1)
    pose[:3, 3] = positive("distance", distance) * outward
    return pose


def sense(
    depth: Array,
    *,
    noise: float,
    flying: float,
    step: float,
    depth_scale: float,
    rng: np.random.Generator,
) -> NDArray[np.uint16]:
    """Return what a depth camera makes of an exact depth image.

    Parameters
    ----------
    depth : (H, W) ndarray
        Exact depths, metres; 0 for no return.
    noise : float
        Standard deviation of the depths, along the camera's z axis, metres; normal.
    flying : float
        Part, from 0 to 1, of the pixels next to a step in depth that fly: they get a depth between
        theirs and the neighbour's across the largest of these steps.
    step : float
        What counts as a step between neighbours in a row or a column, metres.
    depth_scale : float
        Metres for each unit of the result.
    rng : numpy.random.Generator
        The source of chance.

    Returns
    -------
    (H, W) ndarray of uint16
        Depths in units of `depth_scale`, rounded; 0 for no return and for depths that no uint16 holds.

    Raises
    ------
    TypeError
        If `depth` does not hold floating point numbers, a number is none, or `rng` is no generator.
    ValueError
        If `depth` is not two-dimensional and finite, `noise` is negative or not finite, `flying` is
        not from 0 to 1, or `step` or `depth_scale` is not positive.
    """
    exact = finite_array("depth", depth, (None, None))
    noise, flying = not_negative("noise", noise), not_negative("flying", flying)
    if flying > 1:
        raise ValueError(f"flying: expected a part from 0 to 1, got {flying}")
    step, depth_scale = positive("step", step), positive("depth_scale", depth_scale)
    if not isinstance(rng, np.random.Generator):
        raise TypeError(f"rng: expected a numpy.random.Generator, got {type(rng).__name__}")
    returned = exact > 0
    height, width = exact.shape
    around = np.pad(exact, 1)
    largest = np.zeros_like(exact)
    for dv, du in ((0, 1), (1, 0), (1, 2), (2, 1)):
        neighbour = around[dv : dv + height, du : du + width]
        gap = np.where(returned & (neighbour > 0), neighbour - exact, 0.0)
        largest = np.where(np.abs(gap) > np.abs(largest), gap, largest)
    # all numbers are drawn whatever the arguments are: other noise leaves the same pixels flying
    chance, share, error = rng.random(exact.shape), rng.random(exact.shape), rng.normal(size=exact.shape)
    flies = (np.abs(largest) > step) & (chance < flying)
    seen = exact + np.where(flies, share * largest, 0.0) + noise * error
    units = np.rint(seen / depth_scale)
    units[~returned | (units < 0) | (units > np.iinfo(np.uint16).max)] = 0
    return units.astype(np.uint16)


@dataclass(frozen=True, eq=False)
class SyntheticScene:
    """Depth images of strings on a table, and the truth about them.

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
        The strings' radius, metres.
    truth : tuple of (M, 3) ndarray
        The strings' centrelines in the world frame, metres, end to end.
    noise : float
        Standard deviation of the depths, metres.
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

    @property
    def views(self) -> tuple[View, ...]:
        """The images as views, with the poses as read off the stage."""
        return tuple(
            View.from_depth(image * self.depth_scale, self.intrinsics, pose)
            for image, pose in zip(self.depth, self.poses, strict=True)
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write an `.npz` file that `strand.io.load_scene` reads, whole or not at all.

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
        content = BytesIO()
        np.savez_compressed(content, **arrays)
        io.write_bytes(path, content.getvalue())


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
    """Strings on a table, seen by a depth camera that is moved around it.

    The camera looks at the origin from 50 degrees above the table, from azimuths spread evenly over
    -90 to 90 degrees (a single view: from 0), at the least distance, but not under 76 radii, at which
    every view holds the strings whole. The seed turns, mirrors and shifts a named shape on the table,
    stretches its plan by up to 3 percent, and draws the depths' noise, the flying pixels and the errors
    of the poses. The extraction range leaves 6 radii around the strings' axes in x and y, and goes from
    0.6 radii above the table to 3 radii above the highest axis.

    Parameters
    ----------
    name : str, optional
        One of `SHAPES`, "paper" if not given; with `chains`, only what to call the scene.
    chains : sequence of (M, 3) array_like of float, optional
        Strings to show as they are, instead of a shape: nodes in the world frame, metres, about 1 mm
        apart, around the origin, at least a radius above the table.
    seed : int
        The source of chance, not negative.
    radius : float
        The strings' radius, metres.
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
    count, (width, height) = whole("views", views, 1, _VIEWS), _image_size(size)
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
        truth = tuple(_nodes(f"chains[{i}]", chain) for i, chain in enumerate(shown))
        if not truth:
            raise ValueError("chains: expected at least one string, got none")

    azimuths = np.linspace(-0.5 * np.pi, 0.5 * np.pi, count) if count > 1 else np.zeros(1)
    focus, centre = _FOCAL_LENGTH * width, (0.5 * (width - 1), 0.5 * (height - 1))
    intrinsics = np.array([[focus, 0.0, centre[0]], [0.0, focus, centre[1]], [0.0, 0.0, 1.0]])
    nodes = np.concatenate(truth)
    half_view = (0.5 - _BORDER) * np.array([width, height]) / focus
    distance = max(_NEAREST * radius, *(_fitting_distance(nodes, radius, a, half_view) for a in azimuths))
    poses_true = np.stack([camera_pose(azimuth, distance) for azimuth in azimuths])
    table = max(_TABLE, 3.0 * distance)
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


def _nodes(name: str, value: ArrayLike) -> Array:
    nodes = finite_array(name, value, (None, 3))
    if len(nodes) < 2:
        raise ValueError(f"{name}: expected at least two nodes, got {len(nodes)}")
    steps = np.diff(nodes, axis=0)
    if not np.linalg.norm(steps, axis=1).all():
        raise ValueError(f"{name}: expected no two equal nodes in a row")
    sharp = np.flatnonzero((steps[:-1] * steps[1:]).sum(axis=1) <= 0)
    if len(sharp):
        raise ValueError(f"{name}: expected turns under 90 degrees, but node {sharp[0] + 1} turns by more")
    return nodes


def _radii(radius: float | Sequence[float], count: int) -> list[float]:
    if isinstance(radius, (Sequence, np.ndarray)) and np.ndim(radius) > 0:
        radii = [positive(f"radius[{i}]", value, LONGEST) for i, value in enumerate(radius)]
    else:
        radii = [positive("radius", radius, LONGEST)] * count
    if len(radii) != count:
        raise ValueError(f"radius: expected one number or one for each of {count} chains, got {len(radii)}")
    return radii


def _image_size(size: tuple[int, int]) -> tuple[int, int]:
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ValueError("size: expected a pair (width, height) of pixels") from None
    return whole("size[0]", width, 1), whole("size[1]", height, 1)
