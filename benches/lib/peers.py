"""Kernels of strand and their peers in other libraries, run on the same clouds of a rope.

Importing this module binds the process to two processors: Open3D has no setting for its threads, and starts
as many as the processors that it may use when it is imported.
"""
# ruff: noqa: E402

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

THREADS = 2
os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:THREADS])

import numpy as np
import open3d as o3d
import small_gicp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import strand

Array = NDArray[np.float64]
T = TypeVar("T")
Timed = tuple[float, Any]  # seconds, answer

RADIUS = 4.2e-3  # metres: the rope's
SPACING = 0.4e-3  # metres between points of the surface
NOISE = 0.3e-3  # metres: standard deviation along each axis
BEND = 0.05  # metres: amplitude of the rope's curve
PITCH = 0.5  # metres: period of the rope's curve
FILTER_RADIUS = RADIUS / 2  # metres
FILTER_NEIGHBORS = 45  # half of what a point on top of the rope has: the filter drops the flanks
NEAREST = 16  # neighbours of a normal
REACH = RADIUS / 2  # metres: longest correspondence of ICP
ITERATIONS = 20  # of ICP
CENTERLINE_NEIGHBORS = 20  # points around an axis point
NEAR = RADIUS  # metres: shortest step of the tracing
FAR = 2.5 * RADIUS  # metres: longest step of the tracing
MAX_SCIPY_POINTS = 12_000  # above this SciPy's centreline takes one turn
MAX_SLOW_SCIPY_POINTS = 100_000  # above this it takes none: 13 s for 100,000 points
SCIPY_LOT = 1000  # queries at a time: SciPy's neighbours are Python integers
PAUSE = 0.02  # seconds before each run: threads of OpenMP and BLAS spin for a while after their work


def make_rope(count: int, seed: int) -> Array:
    """Return (count, 3) points of a rope's upper half in the plane z = 0, in order along it."""
    rng = np.random.default_rng(seed)
    across = round(math.pi * RADIUS / SPACING)
    row, column = np.divmod(np.arange(count), across)
    x = (row + rng.random(count)) * SPACING
    angle = (column + rng.random(count)) * math.pi / across
    wave = 2 * math.pi / PITCH
    slope = BEND * wave * np.cos(wave * x)
    side = np.stack([-slope, np.ones(count), np.zeros(count)], axis=1) / np.hypot(1.0, slope)[:, None]
    axis = np.stack([x, BEND * np.sin(wave * x), np.zeros(count)], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    surface = axis + RADIUS * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
    return np.asarray(surface + rng.normal(scale=NOISE, size=(count, 3)))


def make_cloud(count: int, seed: int, order: str) -> Array:
    """Return a rope's points in random order or along the rope."""
    points = make_rope(count, seed)
    if order == "random":
        np.random.default_rng(seed).shuffle(points)
    return points


def displace(points: Array) -> Array:
    """Return points as a camera with a small pose error gives them."""
    return np.asarray(points @ strand.rotation_xyz(math.radians(2.0), 0.0, 0.0).T + [3e-4, 5e-4, -4e-4])


def time_call(work: Callable[[], T]) -> tuple[float, T]:
    """Return the seconds that a call takes, and its answer."""
    time.sleep(PAUSE)
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


def make_open3d_cloud(points: Array) -> Any:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


def filter_with_open3d(points: Array) -> Timed:
    cloud = make_open3d_cloud(points)
    seconds, (_, kept) = time_call(lambda: cloud.remove_radius_outlier(FILTER_NEIGHBORS, FILTER_RADIUS))
    mask = np.zeros(len(points), dtype=bool)
    mask[np.asarray(kept)] = True
    return seconds, mask


def estimate_with_open3d(points: Array, search: Any) -> Timed:
    cloud = make_open3d_cloud(points)
    seconds, _ = time_call(lambda: cloud.estimate_normals(search))
    return seconds, np.asarray(cloud.normals)


def estimate_with_small_gicp(points: Array) -> Timed:
    cloud = small_gicp.PointCloud(points)

    def work() -> None:
        tree = small_gicp.KdTree(cloud, num_threads=THREADS)
        small_gicp.estimate_normals(cloud, tree, num_neighbors=NEAREST, num_threads=THREADS)

    seconds, _ = time_call(work)
    return seconds, cloud.normals()[:, :3]


def register_with_strand(source: Array, target: Array) -> Timed:
    seconds, result = time_call(
        lambda: strand.icp(source, target, REACH, max_iterations=ITERATIONS, tolerance=0.0)
    )
    if result.iterations != ITERATIONS:
        raise RuntimeError(f"strand.icp ended after {result.iterations} iterations: {result.stop}")
    return seconds, result.transformation


def register_with_open3d(source: Array, target: Array) -> Timed:
    registration = o3d.pipelines.registration
    moved, still = make_open3d_cloud(source), make_open3d_cloud(target)
    criteria = registration.ICPConvergenceCriteria(0.0, 0.0, ITERATIONS)
    objective = registration.TransformationEstimationPointToPoint()
    seconds, result = time_call(
        lambda: registration.registration_icp(moved, still, REACH, np.eye(4), objective, criteria)
    )
    return seconds, result.transformation


def register_with_small_gicp(source: Array, target: Array) -> Timed:
    moved, still = small_gicp.PointCloud(source), small_gicp.PointCloud(target)
    seconds, result = time_call(
        lambda: small_gicp.align(
            still,
            moved,
            small_gicp.KdTree(still, num_threads=THREADS),
            registration_type="ICP",
            max_correspondence_distance=REACH,
            max_iterations=ITERATIONS,
            rotation_epsilon=0.0,
            translation_epsilon=0.0,
            num_threads=THREADS,
        )
    )
    return seconds, result.T_target_source


def average_with_scipy(points: Array, normals: Array) -> Timed:
    def work() -> tuple[Array, NDArray[np.int64]]:
        tree = cKDTree(points)
        axis = points - RADIUS * normals
        means, indices = [], []
        for first in range(0, len(points), SCIPY_LOT):
            lot = points[first : first + SCIPY_LOT]
            around = tree.query_ball_point(lot, 2 * RADIUS, workers=THREADS)
            for i, neighbors in enumerate(around, start=first):
                if len(neighbors) >= CENTERLINE_NEIGHBORS:
                    means.append(axis[neighbors].mean(axis=0))
                    indices.append(i)
        return np.array(means), np.array(indices)

    return time_call(work)


def compare_masks(ours: NDArray[np.bool_], theirs: NDArray[np.bool_]) -> tuple[bool, str]:
    """Tell whether two masks are the same, and how they differ."""
    different = int((ours != theirs).sum())
    return different == 0, f"{different} of {len(ours)} differ, {int(ours.sum())} kept"


def compare_normals(ours: Array, theirs: Array) -> tuple[bool, str]:
    """Compare normals up to their sign. A normal that only one library has counts as far off."""
    chord = np.minimum(np.linalg.norm(ours - theirs, axis=1), np.linalg.norm(ours + theirs, axis=1))
    worst = math.degrees(float(chord.max()))
    return worst < 0.01, f"within {worst:.1e}°"


def compare_motions(source: Array, tolerance: float) -> Callable[[Array, Array], tuple[bool, str]]:
    """Return a comparison: do two motions bring each source point to the same place, within metres?"""

    def check(ours: Array, theirs: Array) -> tuple[bool, str]:
        difference = ours[:3] - theirs[:3]
        moved = source @ difference[:, :3].T + difference[:, 3]
        worst = float(np.linalg.norm(moved, axis=1).max())
        return worst < tolerance, f"within {worst:.1e} m"

    return check


def compare_centerlines(ours: Any, theirs: Any) -> tuple[bool, str]:
    if not np.array_equal(ours[1], theirs[1]):
        return False, "axis points at other points"
    worst = float(np.abs(ours[0] - theirs[0]).max())
    return worst < 1e-9, f"within {worst:.1e} m"


@dataclass(frozen=True)
class Peer:
    """A kernel of another library, and a comparison of its answer with strand's."""

    name: str
    run: Callable[[], Timed]
    compare: Callable[[Any, Any], tuple[bool, str]]
    once: bool = False  # takes part in the first turn only, because it takes long


@dataclass(frozen=True)
class Stage:
    """A kernel of strand, and its peers."""

    name: str
    run: Callable[[], Timed]
    peers: list[Peer] = field(default_factory=list)
    clouds: int = 1  # each of as many points


def list_stages(count: int, order: str, slow: bool) -> list[Stage]:
    """Return all kernels on clouds of as many points."""
    points, source = make_cloud(count, 1, order), displace(make_cloud(count, 2, order))
    viewpoint = np.array([0.0, 0.0, 1.0])
    nearest = o3d.geometry.KDTreeSearchParamKNN(NEAREST)
    within = o3d.geometry.KDTreeSearchParamRadius(FILTER_RADIUS)
    normals = strand.estimate_normals(points, radius=FILTER_RADIUS, viewpoint=viewpoint)
    axis_points, _ = strand.centerline(points, normals, RADIUS, CENTERLINE_NEIGHBORS)
    scipy_peer = Peer(
        "SciPy",
        lambda: average_with_scipy(points, normals),
        compare_centerlines,
        once=count > MAX_SCIPY_POINTS,
    )
    return [
        Stage(
            "radius filter",
            lambda: time_call(lambda: strand.radius_outlier_mask(points, FILTER_RADIUS, FILTER_NEIGHBORS)),
            [Peer("Open3D", lambda: filter_with_open3d(points), compare_masks)],
        ),
        Stage(
            f"normals, {NEAREST} nearest",
            lambda: time_call(lambda: strand.estimate_normals(points, k=NEAREST, viewpoint=viewpoint)),
            [
                Peer("Open3D", lambda: estimate_with_open3d(points, nearest), compare_normals),
                Peer("small_gicp", lambda: estimate_with_small_gicp(points), compare_normals),
            ],
        ),
        Stage(
            "normals, radius",
            lambda: time_call(
                lambda: strand.estimate_normals(points, radius=FILTER_RADIUS, viewpoint=viewpoint)
            ),
            [Peer("Open3D", lambda: estimate_with_open3d(points, within), compare_normals)],
        ),
        Stage(
            f"ICP, {ITERATIONS} iterations",
            lambda: register_with_strand(source, points),
            [
                Peer("Open3D", lambda: register_with_open3d(source, points), compare_motions(source, 1e-9)),
                # its linearised steps reach the same optimum on another way
                Peer(
                    "small_gicp",
                    lambda: register_with_small_gicp(source, points),
                    compare_motions(source, SPACING / 10),
                ),
            ],
            clouds=2,
        ),
        Stage(
            "centreline",
            lambda: time_call(lambda: strand.centerline(points, normals, RADIUS, CENTERLINE_NEIGHBORS)),
            [scipy_peer] if count <= (MAX_SLOW_SCIPY_POINTS if slow else MAX_SCIPY_POINTS) else [],
        ),
        Stage("tracing", lambda: time_call(lambda: strand.trace_chains(axis_points, NEAR, FAR))),
    ]
