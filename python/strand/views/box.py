"""The extraction range: a box around the ropes, along the world's axes or turned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.support.checks import (
    Array,
    check_float_array,
    check_number,
    check_rigid_motion,
    check_vectors,
    convert_integers,
    freeze_array,
)


@dataclass(frozen=True, eq=False)
class Box:
    """An extraction range: a box in the world, such as the part of a table where the ropes lie.

    Attributes
    ----------
    low, high : (3,) array_like
        Its low and high corner in its own frame, metres. Infinities leave a side open.
    pose : (4, 4) array_like, optional
        Own frame to world; by default the world frame itself. For a box with its centre and its axes in
        `pose`, give `Box(-sizes / 2, sizes / 2, pose)`.

    Raises
    ------
    TypeError
        If the corners or the pose are not numbers.
    ValueError
        If a low corner is not below its high one, or the pose is no rigid motion.

    Examples
    --------
    >>> import strand
    >>> box = strand.Box([-0.2, -0.2, 0.0], [0.2, 0.2, 0.1])
    >>> box.holds([[0.1, 0.0, 0.05], [0.3, 0.0, 0.05]]).tolist()
    [True, False]
    """

    low: Array
    high: Array
    pose: Array | None = None

    def __post_init__(self) -> None:
        low, high = _check_corners("", self.low, self.high)
        object.__setattr__(self, "low", freeze_array(low))
        object.__setattr__(self, "high", freeze_array(high))
        if self.pose is not None:
            object.__setattr__(self, "pose", freeze_array(check_rigid_motion("pose", self.pose)))

    def __str__(self) -> str:
        text = f"{format_point(self.low)} to {format_point(self.high)} m"
        if self.pose is None:
            return text
        return f"{text} in its own frame, whose origin is at {format_point(self.pose[:3, 3])} m"

    def holds(self, points: ArrayLike, margin: float = 0.0) -> NDArray[np.bool_]:
        """Tell which points (..., 3) of the world frame are inside, or at most a margin outside; metres."""
        x, by = self.express(points), check_number("margin", margin)
        return np.asarray(((x >= self.low - by) & (x <= self.high + by)).all(axis=-1))

    def express(self, points: ArrayLike) -> Array:
        """(..., 3) Return points of the world frame, metres, in the box's own frame."""
        places = check_vectors("points", points)
        if self.pose is None:
            return places
        return np.asarray((places - self.pose[:3, 3]) @ self.pose[:3, :3])

    def move_inside(self, points: ArrayLike) -> Array:
        """(..., 3) Return the nearest places of the box to points of the world frame, metres."""
        inside = np.clip(self.express(points), self.low, self.high)
        return inside if self.pose is None else np.asarray(inside @ self.pose[:3, :3].T + self.pose[:3, 3])

    def express_directions(self, vectors: ArrayLike) -> Array:
        """(..., 3) Return directions of the world frame in the box's own frame."""
        given = check_vectors("vectors", vectors)
        return given if self.pose is None else np.asarray(given @ self.pose[:3, :3])

    def express_pose(self, pose: ArrayLike) -> Array:
        """(4, 4) Return a camera-to-world pose as one from the camera to the box's own frame."""
        pose = check_rigid_motion("pose", pose)
        if self.pose is None:
            return pose
        back = self.pose[:3, :3].T
        found = np.eye(4)
        found[:3, :3] = back @ pose[:3, :3]
        found[:3, 3] = back @ (pose[:3, 3] - self.pose[:3, 3])
        return found

    def grown(self, margin: float) -> Box:
        """Return the box, larger by a margin on each side, metres."""
        by = check_number("margin", margin)
        return replace(self, low=self.low - by, high=self.high + by)

    def find_hull(self) -> tuple[Array, Array]:
        """Return the corners of the smallest box along the world's axes around this one, metres."""
        if self.pose is None:
            return self.low, self.high
        turn = self.pose[:3, :3]
        with np.errstate(invalid="ignore"):
            # an edge across an axis does not reach along it, however long it is
            ends = [np.where(turn == 0.0, 0.0, turn * corner) for corner in (self.low, self.high)]
        middle = self.pose[:3, 3]
        return middle + np.minimum(*ends).sum(axis=1), middle + np.maximum(*ends).sum(axis=1)


Bounds = Box | tuple[ArrayLike, ArrayLike]


def make_box(value: Bounds) -> Box:
    """Return `bounds` as a box. A pair is the low and the high corner along the world's axes, metres.

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
    return Box(*_check_corners("bounds: ", low, high))


def _check_corners(of: str, low: ArrayLike, high: ArrayLike) -> tuple[Array, Array]:
    first, last = (
        check_float_array(f"{of}{name}", convert_integers(f"{of}{name}", corner), (3,))
        for name, corner in (("low", low), ("high", high))
    )
    if not (first < last).all():
        raise ValueError(f"{of}expected low < high in x, y and z, got {first} and {last}")
    return first, last


def format_point(point: Array) -> str:
    """Return a point as text for messages, in its own unit."""
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
