"""The extraction range: a box that holds the ropes, along the world's axes or turned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.support.checks import Array, check_float_array, check_rigid_motion, convert_integers, freeze_array


@dataclass(frozen=True, eq=False)
class Box:
    """A box in the world, such as the part of a table where the ropes lie: an extraction range.

    Attributes
    ----------
    low, high : (3,) array_like
        Its low and high corner in its own frame, metres. Infinities leave a side open.
    pose : (4, 4) array_like, optional
        Own frame to world; the world frame itself if not given. A box of sizes (3,) around a centre (3,)
        with its edges along the columns of a rotation R is `Box(-sizes / 2, sizes / 2, pose)` with R and the
        centre in `pose`.

    Raises
    ------
    TypeError
        If the corners or the pose are not numbers.
    ValueError
        If a low corner is not below its high one, or the pose is no rigid motion.
    """

    low: Array
    high: Array
    pose: Array | None = None

    def __post_init__(self) -> None:
        low, high = _corners("", self.low, self.high)
        object.__setattr__(self, "low", freeze_array(low))
        object.__setattr__(self, "high", freeze_array(high))
        if self.pose is not None:
            object.__setattr__(self, "pose", freeze_array(check_rigid_motion("pose", self.pose)))

    def __str__(self) -> str:
        text = f"{metres(self.low)} to {metres(self.high)} m"
        if self.pose is None:
            return text
        return f"{text} in its own frame, whose origin is at {metres(self.pose[:3, 3])} m"

    def holds(self, points: Array, margin: float = 0.0) -> NDArray[np.bool_]:
        """Whether points (..., 3) of the world frame are inside, or a margin or less out of it; metres."""
        x = self.coordinates(points)
        return np.asarray(((x >= self.low - margin) & (x <= self.high + margin)).all(axis=-1))

    def coordinates(self, points: Array) -> Array:
        """(..., 3) Points of the world frame, metres, in the box's own frame."""
        if self.pose is None:
            return points
        return np.asarray((points - self.pose[:3, 3]) @ self.pose[:3, :3])

    def directions(self, vectors: Array) -> Array:
        """(..., 3) Directions of the world frame in the box's own frame."""
        return vectors if self.pose is None else np.asarray(vectors @ self.pose[:3, :3])

    def from_camera(self, pose: Array) -> Array:
        """(4, 4) Camera frame to the box's own frame, for a camera-to-world pose."""
        if self.pose is None:
            return pose
        back = self.pose[:3, :3].T
        found = np.eye(4)
        found[:3, :3] = back @ pose[:3, :3]
        found[:3, 3] = back @ (pose[:3, 3] - self.pose[:3, 3])
        return found

    def grown(self, margin: float) -> Box:
        """Return a box that is larger by a margin on each side, metres."""
        return replace(self, low=self.low - margin, high=self.high + margin)

    def hull(self) -> tuple[Array, Array]:
        """Return the corners of the least box along the world's axes that holds this one, metres."""
        if self.pose is None:
            return self.low, self.high
        turn = self.pose[:3, :3]
        with np.errstate(invalid="ignore"):
            # an edge across an axis does not reach along it, however long it is
            ends = [np.where(turn == 0.0, 0.0, turn * corner) for corner in (self.low, self.high)]
        middle = self.pose[:3, 3]
        return middle + np.minimum(*ends).sum(axis=1), middle + np.maximum(*ends).sum(axis=1)


Bounds = Box | tuple[ArrayLike, ArrayLike]


def extraction_range(value: Bounds) -> Box:
    """Return `bounds` as a box: itself, or the low and the high corner of one along the world's axes, metres.

    Raises
    ------
    TypeError
        If the corners are not numbers.
    ValueError
        If there are not two corners of three numbers, or a low one is not below its high one.
    """
    if isinstance(value, Box):
        return value
    try:
        low, high = value
    except (TypeError, ValueError):
        raise ValueError("bounds: expected a pair (low, high) of corners or a strand.Box") from None
    return Box(*_corners("bounds: ", low, high))


def _corners(of: str, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    first, last = (
        check_float_array(f"{of}{name}", convert_integers(f"{of}{name}", corner), (3,))
        for name, corner in (("low", low), ("high", high))
    )
    if not (first < last).all():
        raise ValueError(f"{of}expected low < high in x, y and z, got {first} and {last}")
    return first, last


def metres(point: Array) -> str:
    """Return a place as messages about ranges show it, in the unit that it has."""
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
