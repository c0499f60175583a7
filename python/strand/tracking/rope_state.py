"""The state of one tracked rope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.ropes.doubt import Doubt
from strand.support.checks import Array

_SHARES = 60  # places along a rope that are compared
SPACING = 2.6  # radii from node to node
MIN_NODES = 10
_FIRST_SD = 0.5  # radii: standard deviation of a node at the beginning
_FIRST_MOTION = 0.3  # radii: standard deviation of a node's motion at the beginning

TENTATIVE = "tentative"
TRACKING = "tracking"
COASTING = "coasting"
LOST = "lost"


@dataclass(frozen=True)
class Hold:
    """A gripper that holds a rope.

    Attributes
    ----------
    s : float
        Place along the rope, metres.
    point : (3,) tuple of float
        Where the place is, world frame, metres.
    sd : float
        Standard deviation, metres.
    """

    s: float
    point: tuple[float, float, float]
    sd: float


@dataclass(frozen=True, eq=False)
class RopeState:
    """A rope after a frame. Arrays have one entry for each of M nodes, metres and seconds.

    Attributes
    ----------
    nodes, velocities, last : (M, 3) ndarray
        Where nodes are, how they move, and where they were last seen, world frame.
    scalars : (M, 3) ndarray
        Variance, variance of the last motion, and time since a node was seen.
    covariances : (M, 3, 3) ndarray
    seen : (M,) ndarray
        Share of a node's samples that pixels support.
    hidden : (M,) ndarray of bool
    slid : float or None
        By how far the tips said lately that the rope slid, towards its last node; None if no tip was seen.
    covers : pair of float or None
        Length of rope that something covers at each end; None at an end that is seen.
    through : float
        Share of the samples that a camera saw through.
    covered_ends : pair of bool
        Which ends count as covered.
    end_counts : pair of int
        Frames in a row in which an end was not as it counts.
    confidence : float
        Of the surest reconstruction that has the rope, without hidden ends; NaN if it says none.
    doubts : tuple of Doubt
        Those of the same reconstruction.
    """

    number: int
    label: int | None
    radius: float
    spacing: float
    length_sd: float
    nodes: Array
    velocities: Array
    last: Array
    scalars: Array
    covariances: Array
    seen: Array
    hidden: NDArray[np.bool_]
    slid: float | None = None
    covers: tuple[float | None, ...] = (None, None)
    through: float = 0.0
    generation: int = 0
    state: str = TENTATIVE
    confidence: float = float("nan")
    covered_ends: tuple[bool, bool] = (False, False)
    end_counts: tuple[int, int] = (0, 0)
    doubts: tuple[Doubt, ...] = ()
    holds: tuple[Hold, ...] = ()

    @property
    def length(self) -> float:
        """Length of the rope, metres."""
        return self.spacing * (len(self.nodes) - 1)


def make_state(
    number: int, points: Array, radius: float, length: float, length_sd: float, label: int | None
) -> RopeState:
    """Return the state of a rope that begins along points (N, 3), with its length, metres."""
    count = max(MIN_NODES, round(length / (SPACING * radius)) + 1)
    nodes = resample(points, np.linspace(0.0, 1.0, count))
    return RopeState(
        number=number,
        label=label,
        radius=radius,
        spacing=length / (count - 1),
        length_sd=length_sd,
        nodes=nodes,
        velocities=np.zeros_like(nodes),
        last=nodes,
        scalars=np.tile([(_FIRST_SD * radius) ** 2, (_FIRST_MOTION * radius) ** 2, 0.0], (count, 1)),
        covariances=np.tile((_FIRST_SD * radius) ** 2 * np.eye(3), (count, 1, 1)),
        seen=np.ones(count),
        hidden=np.zeros(count, dtype=bool),
    )


def measure_arcs(points: Array) -> Array:
    """Return (N,) arc lengths along (N, 3) points, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def resample(points: Array, shares: Array) -> Array:
    """Return (K, 3) places at shares (K,) of the length of (N, 3) points, from 0 to 1."""
    arcs = measure_arcs(points)
    return place_at(points, arcs, shares * arcs[-1])


def measure_offset(nodes: Array, points: Array) -> float:
    """Return how far apart two lines (N, 3), (K, 3) are on average, whichever way they run, metres."""
    shares = np.linspace(0.0, 1.0, _SHARES)
    line, other = resample(nodes, shares), resample(points, shares)
    return min(float(np.linalg.norm(line - way, axis=1).mean()) for way in (other, other[::-1]))


def place_at(points: Array, arcs: Array, s: Array) -> Array:
    """Return (K, 3) places at arc lengths (K,); beyond the ends, the rope goes on straight."""
    found = np.stack([np.interp(s, arcs, points[:, k]) for k in range(3)], axis=1)
    before, after = s < 0.0, s > arcs[-1]
    if before.any():
        found[before] = points[0] + np.outer(-s[before], _point_out(points))
    if after.any():
        found[after] = points[-1] + np.outer(s[after] - arcs[-1], _point_out(points[::-1]))
    return found


def _point_out(points: Array) -> Array:
    """Return the unit direction in which a line leaves its first point."""
    out = points[0] - points[min(6, len(points) - 1)]
    return np.asarray(out / max(float(np.linalg.norm(out)), 1e-12))
