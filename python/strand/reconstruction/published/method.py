"""The published method: normals, ICP, averaged axis points, greedy tracing, split and reconnection.

Sections and equations are those of *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.config import Config
from strand.geometry.polyline import path_length
from strand.reconstruction.published.assembly import assemble
from strand.reconstruction.published.reconnection import reconnect
from strand.reconstruction.published.splitting import split
from strand.reconstruction.stages import Found, Observed, Run
from strand.reconstruction.wide_surfaces import describe_surface
from strand.ropes.chain import Chain
from strand.ropes.doubt import ModelWarning
from strand.support.checks import Array
from strand.views.pose import moved
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class _Cloud:
    """One view's points and normals in the world frame."""

    number: int
    view: View
    points: Array
    normals: Array

    def moved(self, motion: Array) -> _Cloud:
        """Return the cloud after a rigid motion of the world frame, camera included."""
        return replace(
            self,
            view=self.view.moved(motion),
            points=moved(self.points, motion),
            normals=self.normals @ motion[:3, :3].T,
        )


def find_chains(observed: Observed, config: Config, run: Run) -> Found:
    """Run the published stages on filtered views of ropes of one radius, which stays as given.

    The stages are "normals", "registered", "axis_points", "traced", "separation", "cuts" and "segments".
    Raises NotEnoughDataError if the points make no chain, or do not look like ropes.
    """
    radius = float(observed.radii.values[0])
    wide = describe_surface(observed.views, radius)
    if wide:
        raise NotEnoughDataError(f"views: {wide}")
    with run.stage("normals"):
        clouds = _estimate_normals(observed.numbers, observed.views, radius, config)
    with run.stage("register"):
        registered = _register(clouds, radius, config, run)
    with run.stage("centerline"):
        points = np.concatenate([cloud.points for cloud in registered])
        normals = np.concatenate([cloud.normals for cloud in registered])
        axis_points, _ = _core.centerline(points, normals, radius, config.centerline.min_neighbors)
    with run.stage("trace"):
        traced = _trace(axis_points, radius, config)
    with run.stage("split"):
        parts = split(traced, radius, config.splitting)
    with run.stage("reconnect"):
        reconnected = reconnect(parts, radius, observed.prior.ropes, config.reconnection)
        found = assemble(parts.segments, reconnected, points - radius * normals, radius, config.reconnection)
    stages = {
        "normals": tuple(cloud.normals for cloud in clouds),
        "registered": tuple(cloud.points for cloud in registered),
        "axis_points": axis_points,
        "traced": traced,
        "separation": parts.distances,
        "cuts": parts.cuts,
        "segments": parts.segments,
    }
    chains = [Chain(nodes, radius, closed) for nodes, closed in found]
    return Found(
        sorted(chains, key=lambda chain: -chain.length),
        [cloud.view.pose for cloud in registered],
        [np.full(6, np.nan) for _ in registered],
        stages,
    )


def _estimate_normals(
    numbers: Sequence[int], views: Sequence[View], radius: float, config: Config
) -> list[_Cloud]:
    """Estimate normals in the camera frames, towards the camera, and turn them to the world frame."""
    found = _core.estimate_normals_each([view.points for view in views], config.normals.radius * radius)
    return [
        _Cloud(number, view, view.world_points, normals @ view.pose[:3, :3].T)
        for number, view, normals in zip(numbers, views, found, strict=True)
    ]


def _register(clouds: Sequence[_Cloud], radius: float, config: Config, run: Run) -> list[_Cloud]:
    """Register the views to the middle one (eq. 15).

    Each goes to all that are registered, from the middle outwards.
    """
    numbers = config.registration
    middle = len(clouds) // 2
    turns = sorted(range(len(clouds)), key=lambda i: abs(i - middle))
    results = _core.register_in_turn(
        [clouds[i].points for i in turns],
        numbers.max_correspondence_distance * radius,
        numbers.max_iterations,
        numbers.tolerance,
    )
    registered = {middle: clouds[middle]}
    for i, result in zip(turns[1:], results, strict=True):
        if result.stop in ("too few correspondences", "degenerate"):
            message = f"view {clouds[i].number} kept its pose: {result.stop} to register it"
            run.warnings.append(ModelWarning("kept pose", message, view=clouds[i].number))
        registered[i] = clouds[i].moved(result.transformation)
    return [registered[i] for i in range(len(clouds))]


def _trace(axis_points: Array, radius: float, config: Config) -> tuple[Array, ...]:
    """Trace chains (section V-A) and drop the short ones."""
    numbers = config.tracing
    chains = _core.trace_chains(axis_points, numbers.near * radius, numbers.far * radius)
    traced = (axis_points[chain] for chain in chains)
    long_enough = tuple(c for c in traced if path_length(c)[-1] >= numbers.min_length * radius)
    if not long_enough:
        raise NotEnoughDataError("views: the points make no chain; is the radius right, in metres?")
    return long_enough
