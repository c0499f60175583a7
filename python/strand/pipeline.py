"""reconstruct(): views in, a point chain model out. Composition only."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand import _core, strings, topology
from strand._core import NotEnoughDataError
from strand.config import Config
from strand.model import Chain, Model
from strand.view import Array, View


@dataclass
class _Run:
    """What a run gathers beside its result."""

    progress: Callable[[str], None] | None
    timings: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage and time it."""
        if self.progress is not None:
            self.progress(name)
        start = time.perf_counter()
        yield
        self.timings[name] = time.perf_counter() - start


@dataclass(frozen=True, eq=False)
class _Cloud:
    """What is used of one view, in the world frame."""

    number: int
    view: View
    points: Array
    normals: Array

    def moved(self, motion: Array) -> _Cloud:
        """Return the cloud after a rigid motion of the world frame, camera included."""
        rotation, translation = motion[:3, :3], motion[:3, 3]
        return replace(
            self,
            view=replace(self.view, pose=motion @ self.view.pose),
            points=self.points @ rotation.T + translation,
            normals=self.normals @ rotation.T,
        )


def reconstruct(
    views: Sequence[View],
    radius: float | None = None,
    bounds: tuple[ArrayLike, ArrayLike] | None = None,
    ropes: int | None = None,
    config: Config | None = None,
    *,
    keep_stages: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Model:
    """Turn depth-camera views of strings into ordered centrelines.

    Parameters
    ----------
    views : sequence of View
        What the cameras saw. Registration keeps the middle one of those that see something where it is.
    radius : float
        The string's radius, metres.
    bounds : pair of (3,) array_like of float, optional
        The extraction range: low and high corner of an axis-aligned box in the world frame, metres;
        everything if not given.
    ropes : int, optional
        How many ropes there are; as many as the data show if not given.
    config : Config, optional
        The numbers of the method; `Config.published()` if not given.
    keep_stages : bool
        Keep the arrays between the stages, in `Model.stages`: "raw", "filtered", "normals" and
        "registered" (a tuple of (N, 3) arrays, one for each view used), "axis_points" (M, 3), "traced"
        (chains before the split), "separation" (d* along each), "cuts" (its nodes that were cut at) and
        "segments".
    progress : callable, optional
        Called with each stage's name when it starts.

    Returns
    -------
    Model

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a number is out of range, there are no views, or `radius` is not given.
    strand.NotEnoughDataError
        If no view has points in the extraction range, or they make no chain.
    """
    config = Config.published() if config is None else config
    views, radius, ropes = _checked(views, radius, ropes, config)
    run = _Run(progress)
    with run.stage("extract"):
        raw = [view if bounds is None else view.crop(bounds) for view in views]
    with run.stage("filter"):
        filtered = [_filtered(view, radius, config) for view in raw]
    used = _used(raw, filtered, run)
    with run.stage("normals"):
        clouds = [_with_normals(number, filtered[number], radius, config) for number in used]
    with run.stage("register"):
        registered = _registered(clouds, radius, config, run)
    with run.stage("centerline"):
        points = np.concatenate([cloud.points for cloud in registered])
        normals = np.concatenate([cloud.normals for cloud in registered])
        axis_points, _ = _core.centerline(points, normals, radius, config.centerline.min_neighbors)
    with run.stage("trace"):
        traced = _traced(axis_points, radius, config)
    with run.stage("split"):
        parts = topology.split(traced, radius, config.splitting)
    with run.stage("reconnect"):
        reconnected = topology.reconnect(parts, radius, ropes, config.reconnection)
        found = strings.assemble(
            parts.segments, reconnected, points - radius * normals, radius, config.reconnection
        )
        chains = _chosen([Chain(nodes, radius, closed) for nodes, closed in found], ropes, run)
    poses = np.array([view.pose for view in views])
    poses[used] = [cloud.view.pose for cloud in registered]
    stages: dict[str, Any] = {}
    if keep_stages:
        stages = {
            "raw": tuple(raw[number].world_points for number in used),
            "filtered": tuple(cloud.points for cloud in clouds),
            "normals": tuple(cloud.normals for cloud in clouds),
            "registered": tuple(cloud.points for cloud in registered),
            "axis_points": axis_points,
            "traced": traced,
            "separation": parts.distances,
            "cuts": parts.cuts,
            "segments": parts.segments,
        }
    return Model(chains, poses, run.timings, tuple(run.warnings), stages)


def _checked(
    views: Sequence[View], radius: float | None, ropes: int | None, config: Config
) -> tuple[tuple[View, ...], float, int | None]:
    """Check the arguments that have no type of their own."""
    if isinstance(views, View):
        raise TypeError("views: expected a sequence of View, got a single View")
    views = tuple(views)
    for i, view in enumerate(views):
        if not isinstance(view, View):
            raise TypeError(f"views[{i}]: expected a View, got {type(view).__name__}")
    if not views:
        raise ValueError("views: expected at least one View, got none")
    if radius is None:
        raise ValueError("radius: the published method needs the string's radius, metres")
    if isinstance(radius, bool) or not isinstance(radius, (int, float, np.floating)):
        raise TypeError(f"radius: expected a number of metres, got {radius!r}")
    if not (math.isfinite(radius) and radius > 0):
        raise ValueError(f"radius: expected a positive number of metres, got {radius}")
    if ropes is not None:
        if isinstance(ropes, bool) or not isinstance(ropes, (int, np.integer)):
            raise TypeError(f"ropes: expected a whole number or None, got {ropes!r}")
        if ropes < 1:
            raise ValueError(f"ropes: expected at least 1, got {ropes}")
    if not isinstance(config, Config):
        raise TypeError(f"config: expected a Config, got {config!r}")
    return views, float(radius), ropes


def _filtered(view: View, radius: float, config: Config) -> View:
    """Drop outliers (section IV-A)."""
    counts = _core.count_neighbors(view.points, config.filter.radius * radius)
    if not len(counts):
        return view
    enough = max(config.filter.min_fraction * float(np.median(counts)), config.filter.min_neighbors)
    return replace(view, points=view.points[counts >= enough])


def _used(raw: Sequence[View], filtered: Sequence[View], run: _Run) -> list[int]:
    """Numbers of the views that see something; the others are named in a warning."""
    used = [number for number, view in enumerate(filtered) if len(view.points)]
    if not used:
        if any(len(view.points) for view in raw):
            raise NotEnoughDataError("views: all points are outliers; is the radius right, in metres?")
        raise NotEnoughDataError("views: no view has a point in the extraction range")
    for number in sorted(set(range(len(raw))) - set(used)):
        reason = "only outliers" if len(raw[number].points) else "no points"
        run.warnings.append(f"view {number} has {reason} in the extraction range and was not used")
    return used


def _with_normals(number: int, view: View, radius: float, config: Config) -> _Cloud:
    """Estimate normals in the camera frame, where the camera is the origin, and go to the world frame."""
    normals = _core.estimate_normals(view.points, radius=config.normals.radius * radius)
    return _Cloud(number, view, view.world_points, normals @ view.pose[:3, :3].T)


def _registered(clouds: Sequence[_Cloud], radius: float, config: Config, run: _Run) -> list[_Cloud]:
    """Register the views to the middle one, from there outwards, each to all that are registered (eq. 15)."""
    numbers = config.registration
    middle = len(clouds) // 2
    registered = {middle: clouds[middle]}
    for i in sorted(range(len(clouds)), key=lambda i: abs(i - middle))[1:]:
        target = np.concatenate([cloud.points for cloud in registered.values()])
        result = _core.icp(
            clouds[i].points,
            target,
            numbers.max_correspondence_distance * radius,
            max_iterations=numbers.max_iterations,
            tolerance=numbers.tolerance,
        )
        if result.stop in ("too few correspondences", "degenerate"):
            run.warnings.append(f"view {clouds[i].number} kept its pose: {result.stop} to register it")
        registered[i] = clouds[i].moved(result.transformation)
    return [registered[i] for i in range(len(clouds))]


def _traced(axis_points: Array, radius: float, config: Config) -> tuple[Array, ...]:
    """Trace chains (section V-A) and leave out the short ones."""
    numbers = config.tracing
    chains = _core.trace_chains(axis_points, numbers.near * radius, numbers.far * radius)
    traced = (axis_points[chain] for chain in chains)
    long_enough = tuple(c for c in traced if topology.path_length(c)[-1] >= numbers.min_length * radius)
    if not long_enough:
        raise NotEnoughDataError("views: the points make no chain; is the radius right, in metres?")
    return long_enough


def _chosen(chains: list[Chain], ropes: int | None, run: _Run) -> tuple[Chain, ...]:
    """Keep as many strings as there are ropes, longest first."""
    chains = sorted(chains, key=lambda chain: -chain.length)
    if ropes is not None:
        if len(chains) < ropes:
            run.warnings.append(f"found {len(chains)} strings, fewer than ropes = {ropes}")
        for chain in chains[ropes:]:
            where = np.round(chain.points[0], 3).tolist()
            run.warnings.append(
                f"left out a piece {chain.length * 1e3:.0f} mm long at {where}, more than ropes = {ropes}"
            )
        chains = chains[:ropes]
    return tuple(chains)
