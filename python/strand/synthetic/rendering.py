"""Exact depth images of ropes on a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.support.checks import (
    Array,
    check_finite_array,
    check_integer,
    check_intrinsics,
    check_nonnegative,
    check_positive,
    check_rigid_motion,
    check_sequence,
    refuse_masks_and_units,
)
from strand.synthetic.shapes import LONGEST

TABLE = 1.0
"""Side of the default table, metres."""

_BATCH_SIZE = 1 << 18  # pairs of a tube segment and a pixel that are cast at once: bounds the memory

_Indices = NDArray[np.int64]


def render_depth(
    chains: Sequence[ArrayLike],
    radius: float | Sequence[float],
    intrinsics: ArrayLike,
    pose: ArrayLike,
    size: tuple[int, int] = (320, 240),
    table: float = True,
) -> Array:
    """Return the depth image of ropes on a table, by casting a ray through the centre of every pixel.

    A rope is a round tube around the straight segments between its nodes, mitred at the nodes and cut flat
    at its two ends. A ray hits it from outside only. A bend tighter than the rope's radius is drawn wrongly.

    Parameters
    ----------
    chains : sequence of (M, 3) array_like of float
        Nodes of each rope in the world frame, metres, from end to end.
    radius : float or sequence of float
        Radius of all ropes, metres, or one radius per rope.
    intrinsics : (3, 3) array_like
        The pinhole matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
    pose : (4, 4) array_like
        Camera-to-world rigid motion; the camera frame is x right, y down, z forward.
    size : (int, int)
        Width and height of the image, pixels.
    table : float
        Side of the table, metres, a square around the origin of the plane z = 0. True means 1 m, and False
        or 0 means no table.

    Returns
    -------
    (H, W) ndarray
        Depth along the camera's z axis, metres; 0 where a ray hits nothing. Integer coordinates are pixel
        centres.

    Raises
    ------
    TypeError
        If an array does not hold floating point numbers, a radius is not a number, or `size` does not
        hold integers.
    ValueError
        If a chain is not (M, 3) with M >= 2, is not finite, has equal neighbours or turns by 90 degrees or
        more at a node; a radius is not positive, or the number of radii differs from that of the chains; the
        intrinsics are not a pinhole's; `pose` is not a rigid motion; `size` is not two positive numbers; or
        `table` is negative or not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from strand.synthetic import camera_pose, render_depth, shape
    >>> intrinsics = np.array([[212.0, 0.0, 159.5], [0.0, 212.0, 119.5], [0.0, 0.0, 1.0]])
    >>> depth = render_depth([shape("arc")], 0.0042, intrinsics, camera_pose(azimuth=0.0, distance=0.4))
    >>> depth.shape
    (240, 320)
    """
    tubes = [
        check_rope(f"chains[{i}]", chain)
        for i, chain in enumerate(check_sequence("chains", chains, "arrays"))
    ]
    radii = _check_radii(radius, len(tubes))
    camera = check_intrinsics("intrinsics", intrinsics)
    fx, fy, cx, cy = camera[0, 0], camera[1, 1], camera[0, 2], camera[1, 2]
    motion = check_rigid_motion("pose", pose)
    width, height = check_size(size)
    side = float(table) * TABLE if isinstance(table, bool) else check_nonnegative("table", table)

    rotation, center = motion[:3, :3], motion[:3, 3]
    # at z = 1 in the camera frame, so that the parameter along a ray is the depth
    x, y = (np.arange(width) - cx) / fx, (np.arange(height) - cy) / fy
    depth = np.full((height, width), np.inf)
    if side > 0:
        ray = [rotation[k, 0] * x + (rotation[k, 1] * y + rotation[k, 2])[:, None] for k in range(3)]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = -center[2] / ray[2]
            hit = (t > 0) & (np.abs(center[0] + t * ray[0]) <= 0.5 * side)
            hit &= np.abs(center[1] + t * ray[1]) <= 0.5 * side
        depth[hit] = t[hit]
    for nodes, tube_radius in zip(tubes, radii, strict=True):
        _cast_tube(depth, x, y, (nodes - center) @ rotation, tube_radius)
    depth[np.isinf(depth)] = 0.0
    return depth


def _cast_tube(depth: Array, x: Array, y: Array, nodes: Array, radius: float) -> None:
    """Lower the (H, W) depths to the tube around `nodes`, where the tube is nearer.

    `x` (W,) and `y` (H,) are the directions of the columns' and rows' rays at z = 1. `nodes` are in the
    camera frame.
    """
    axes = np.diff(nodes, axis=0)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    # two segments meet in the plane that halves their angle
    cuts = np.vstack([axes[:1], axes[:-1] + axes[1:], axes[-1:]])
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    begin, end = (nodes[:-1] * cuts[:-1]).sum(axis=1), (nodes[1:] * cuts[1:]).sum(axis=1)
    rims = radius / np.concatenate([(cuts[:-1] * axes).sum(axis=1), [1.0]])
    low, high = _find_pixel_boxes(x, y, nodes, rims)
    low, high = np.minimum(low[:-1], low[1:]), np.maximum(high[:-1], high[1:])
    ahead = nodes[:, 2] + rims > 0
    high[~(ahead[:-1] | ahead[1:])] = 0

    start = nodes[:-1]
    along = (start * axes).sum(axis=1)
    excess = (start * start).sum(axis=1) - along**2 - radius**2
    image, tolerance = depth.reshape(-1), 1e-9 * radius
    for i, u, v in _iterate_pixels(low, high):
        ray = np.stack([x[u], y[v], np.ones(len(u))], axis=1)
        # a ray crosses the cylinder at two depths; the first is on its outside
        slope = _dot(axes[i], ray)
        square = _dot(ray, ray) - slope * slope
        half = _dot(start[i], ray) - slope * along[i]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (half - np.sqrt(half * half - square * excess[i])) / square
            hit = (t > 0) & (t * _dot(cuts[i], ray) >= begin[i] - tolerance)
            hit &= t * _dot(cuts[i + 1], ray) <= end[i] + tolerance
        np.minimum.at(image, (v * len(x) + u)[hit], t[hit])

    for node, outward in ((nodes[:1], -axes[0]), (nodes[-1:], axes[-1])):
        (low,), (high,) = _find_pixel_boxes(x, y, node, np.array([radius]))
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


def _find_pixel_boxes(x: Array, y: Array, centers: Array, radii: Array) -> tuple[_Indices, _Indices]:
    """Return the first column and row of pixels that can see each ball, and those after the last: (N, 2).

    A ball that reaches beside or behind the camera may be anywhere in the image.
    """
    near, far = centers[:, 2] - radii, centers[:, 2] + radii
    low, high = np.zeros((len(centers), 2), dtype=np.int64), np.empty((len(centers), 2), dtype=np.int64)
    for k, directions in enumerate((x, y)):
        before, after = centers[:, k] - radii, centers[:, k] + radii
        with np.errstate(divide="ignore", invalid="ignore"):
            first, last = np.minimum(before / near, before / far), np.maximum(after / near, after / far)
        low[:, k] = np.where(near > 0, np.searchsorted(directions, first, side="left"), 0)
        high[:, k] = np.where(near > 0, np.searchsorted(directions, last, side="right"), len(directions))
    return low, high


def _iterate_pixels(low: _Indices, high: _Indices) -> Iterator[tuple[_Indices, _Indices, _Indices]]:
    """Yield the box, column and row of every pixel of every box, many boxes at a time."""
    columns, rows = np.clip(high - low, 0, None).T
    counts = columns * rows
    ends = np.cumsum(counts)
    first = 0
    while first < len(counts):
        done = ends[first] - counts[first]
        last = max(first + 1, int(np.searchsorted(ends, done + _BATCH_SIZE, side="right")))
        box = np.repeat(np.arange(first, last), counts[first:last])
        within = done + np.arange(len(box)) - (ends - counts)[box]
        yield box, low[box, 0] + within % columns[box], low[box, 1] + within // columns[box]
        first = last


def check_rope(name: str, value: ArrayLike) -> Array:
    """Return a rope's (M, 3) nodes, checked: at least two, no equal neighbours, turns under 90 degrees."""
    nodes = check_finite_array(name, value, ("N", 3))
    if len(nodes) < 2:
        raise ValueError(f"{name}: expected at least two nodes, got {len(nodes)}")
    steps = np.diff(nodes, axis=0)
    if not np.linalg.norm(steps, axis=1).all():
        raise ValueError(f"{name}: expected no two equal nodes in a row")
    sharp = np.flatnonzero((steps[:-1] * steps[1:]).sum(axis=1) <= 0)
    if len(sharp):
        raise ValueError(f"{name}: expected turns below 90 degrees, got a sharper one at node {sharp[0] + 1}")
    return nodes


def _check_radii(radius: float | Sequence[float], count: int) -> list[float]:
    refuse_masks_and_units("radius", radius)
    if isinstance(radius, (Sequence, np.ndarray)) and np.ndim(radius) > 0:
        radii = [check_positive(f"radius[{i}]", value, LONGEST) for i, value in enumerate(radius)]
    else:
        radii = [check_positive("radius", radius, LONGEST)] * count
    if len(radii) != count:
        raise ValueError(f"radius: expected one number, or one for each of {count} chains, got {len(radii)}")
    return radii


def check_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return an image's width and height, pixels, checked."""
    try:
        width, height = size
    except (TypeError, ValueError):
        raise ValueError("size: expected a pair (width, height) of pixels") from None
    return check_integer("size[0]", width, 1), check_integer("size[1]", height, 1)
