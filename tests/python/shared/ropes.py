"""Ropes and views that several tests draw, and questions to models."""

from __future__ import annotations

import numpy as np

import strand
from strand import Chain, Model
from strand.geometry.curve import Curve
from strand.synthetic import camera_pose, render_depth, sense

R = 0.0042
# the place of `sample_strip`'s camera
CAMERA = np.array([0.0, 0.0, 0.4])


def find_warnings(model, kind):
    """Return a model's warnings of one kind."""
    return [warning for warning in model.warnings if warning.kind == kind]


def draw_line(start, stop):
    """Return nodes half a radius apart from one place to another."""
    start, stop = np.array(start, float), np.array(stop, float)
    count = max(int(np.linalg.norm(stop - start) / (0.5 * R)), 2) + 1
    return start + np.linspace(0.0, 1.0, count)[:, None] * (stop - start)


def find_rope_pixels(scene):
    """Return (V, H, W) the pixels of a scene's images that see its ropes."""
    size = scene.depth.shape[:0:-1]
    images = [
        render_depth(scene.truth, scene.radius, scene.intrinsics, pose, size, table=0.0)
        for pose in scene.poses_true
    ]
    return np.stack(images) > 0


def sample_tube(axis: np.ndarray, camera: np.ndarray, noise: float, seed: int = 0) -> np.ndarray:
    """Return points evenly over the half of a tube's surface that faces a camera."""
    rng = np.random.default_rng(seed)
    chain = strand.Chain(axis, R)
    s = rng.uniform(0, chain.length, int(chain.length / 5e-5))
    tangent = np.stack([np.interp(s, chain.arc_length, chain.tangents[:, k]) for k in range(3)], axis=1)
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = rng.uniform(0, 2 * np.pi, (len(s), 1))
    outward = np.cos(angle) * across + np.sin(angle) * np.cross(across, tangent)
    points = chain.at(s) + (R + rng.normal(scale=noise, size=(len(s), 1))) * outward
    return points[(outward * (camera - points)).sum(axis=1) > 0]


def hide_behind_plate(scene, low, high, z):
    """Return views of a scene behind a level plate at the height z, between two corners in x and y."""
    views = []
    (fx, _, cx), (_, fy, cy), _ = scene.intrinsics
    for depth, pose, true in zip(scene.depth, scene.poses, scene.poses_true, strict=True):
        v, u = np.indices(depth.shape)
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], axis=2) @ true[:3, :3].T
        plate = (z - true[2, 3]) / rays[..., 2]
        place = true[:2, 3] + plate[..., None] * rays[..., :2]
        seen = depth * scene.depth_scale
        hides = ((place > low) & (place < high)).all(axis=2) & ((seen == 0) | (plate < seen))
        views.append(strand.View.from_depth(np.where(hides, plate, seen), scene.intrinsics, pose))
    return views


def measure_length(nodes):
    return strand.Chain(nodes, R).length


def draw_circle(radius: float, nodes: int, closed: bool) -> Chain:
    angle = np.linspace(0, 2 * np.pi, nodes, endpoint=not closed)
    if not closed:
        angle *= 0.75
    return Chain(
        np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.1 * angle * 0], axis=1), 0.004, closed
    )


def make_zigzags(nodes: int) -> Model:
    """Return a model of two chains that cross in nearly all pairs of their segments."""
    along, across = np.linspace(0.0, 1.0, nodes), np.arange(nodes) % 2.0
    low = np.column_stack([along, across, np.zeros(nodes)])
    high = np.column_stack([across, along, np.full(nodes, 0.01)])
    return Model((Chain(low, 1e-4), Chain(high, 1e-4)), np.eye(4)[None])


def measure_max_distance(chain, truth):
    """Return the greatest distance of a chain's nodes from a true centreline, in radii."""
    return strand.Chain(truth, R).nearest(chain.points).distance.max() / R


def sample_strip(radius: float, depth_noise: float = 0.0, seed: int = 0) -> np.ndarray:
    """Return points of a straight tube's upper half, evenly over the image of a camera above it."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.1, 0.1, 4000), rng.uniform(-radius, radius, 4000)
    z = np.sqrt(radius**2 - y**2)
    points = np.stack([x, y, z], axis=1)
    ray = points - CAMERA
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    return points + rng.normal(scale=depth_noise, size=(4000, 1)) * ray


def render_crossing(
    thin: float, thick: float, seed: int = 0, size: tuple[int, int] = (640, 480), count: int = 5
):
    """Return views, extraction range and true axes of two ropes, the second over the first."""
    t = np.linspace(-0.5, 0.5, 400)
    under = np.stack([0.3 * t, 0.03 * np.sin(5 * t), thin + 0 * t], axis=1)
    over = np.stack([0.03 * np.sin(4 * t), 0.24 * t, 0 * t], axis=1)
    over[:, 2] = thick + (2 * thin + 5e-4) * np.exp(-((over[:, 1] / 0.04) ** 2))
    width, height = size
    focal = 430.0 / 640.0 * width
    intrinsics = np.array(
        [[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]]
    )
    rng = np.random.default_rng(seed)
    views = []
    for azimuth in np.linspace(-0.5 * np.pi, 0.5 * np.pi, count):
        pose = camera_pose(azimuth, 0.38)
        depth = render_depth([under, over], [thin, thick], intrinsics, pose, size)
        image = sense(depth, noise=7e-4, flying=0.05, step=thin, depth_scale=1e-4, rng=rng)
        views.append(strand.View.from_depth(image * 1e-4, intrinsics, pose))
    nodes = np.concatenate([under, over])
    low, high = nodes.min(axis=0) - 0.02, nodes.max(axis=0) + 0.02
    low[2] = 0.6 * thin
    return views, (low, high), (under, over)


CROSSED = 0.004  # metres: radius of the chains of `draw_cross`


def draw_straight(start: tuple[float, ...], end: tuple[float, ...], spacing: float = CROSSED) -> np.ndarray:
    """Return the nodes of a straight chain."""
    a, b = np.array(start, dtype=float), np.array(end, dtype=float)
    count = int(np.linalg.norm(b - a) / spacing) + 1
    return a + np.linspace(0, 1, count)[:, None] * (b - a)


def draw_cross(angle: float = np.pi / 2) -> list[np.ndarray]:
    """Return two straight chains that cross in the middle, the second two radii higher."""
    along = 0.05 * np.array([np.cos(angle), np.sin(angle), 0.0])
    up = np.array([0, 0, 2 * CROSSED])
    return [draw_straight((-0.05, 0, 0), (0.05, 0, 0)), draw_straight(tuple(up - along), tuple(up + along))]


def make_smooth_chain() -> Chain:
    """Return an open rope with bends of several radii, whose nodes lie on a smooth curve."""
    t = np.linspace(0.0, 4.0 * np.pi, 40)
    control = np.stack([0.03 * np.cos(t), 0.03 * np.sin(2.0 * t), 0.005 * t], axis=1)
    curve = Curve.whole(control)
    return Chain(curve.at(curve.spaced(0.001))[0], R, curve=curve)


def measure_path_distance(points: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Return (N,) the distance of points from the nearest of K segments between places, (K, 3) each."""
    line = stop - start
    square = np.maximum((line * line).sum(axis=1), 1e-30)
    nearest = np.full(len(points), np.inf)
    for k in range(len(line)):
        offset = points - start[k]
        offset -= np.clip(offset @ line[k] / square[k], 0.0, 1.0)[:, None] * line[k]
        nearest = np.minimum(nearest, np.linalg.norm(offset, axis=1))
    return nearest
