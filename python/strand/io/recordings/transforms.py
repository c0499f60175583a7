"""Find the pose of one frame in another at a given time, from TF's tree of transforms."""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

TF_KINDS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_TRANSFORM = 160  # bytes of a transform, with those of its copy while they are put in order
_NUMBERS = 7  # of a transform: those of its translation and its quaternion
_EDGE = 1024  # bytes of a frame beside its name
_MAX_STEPS = 64  # frames between a frame and the root; robots have up to about 50
_MAX_PATHS = 64  # paths between two frames that are kept
_EVER = 1 << 63  # nanoseconds: after all times
_MAX_TRANSLATION = 1e9  # metres: the moon is nearer
_MAX_NORM_ERROR = 0.01  # how far the norm of a quaternion may be from 1
_MIN_ANGLE = 1e-6  # radians: below it, interpolation of rotations is linear
_MAX_LISTED = 20  # frames that an error message names
GAP = 2 * 10**8  # nanoseconds: shorter times between transforms are no gap
_GAP_STEPS = 5  # usual times between transforms: shorter times are no gap
_STILL = 1e-3, 2e-3  # metres, radians: frames that move less from transform to transform stand still


@dataclass
class _Edge:
    """The transforms from a frame to its parent.

    Attributes
    ----------
    parent : str
    static : bool
        Whether the last transform holds at all times.
    times : array of int
        Nanoseconds since 1970.
    values : array of float
        Translation (metres) and unit quaternion x, y, z, w of each transform.
    ordered : bool
        Whether the times are in order.
    gaps : pair of arrays, or None
        The answer of `find_gaps`, if it is known.
    """

    parent: str
    static: bool
    times: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    ordered: bool = True
    gaps: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None

    def order(self) -> None:
        """Put the transforms in the order of time."""
        if not self.ordered:
            times = np.array(self.times)
            order = np.argsort(times, kind="stable")
            self.times = array("q", times[order].tobytes())
            self.values = array("d", np.array(self.values).reshape(-1, _NUMBERS)[order].tobytes())
            self.ordered = True

    def list_gaps(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the gaps between the transforms, which are in order."""
        if self.gaps is None:
            self.gaps = find_gaps(self.times, self.values)
        return self.gaps

    def find(self, time: int) -> tuple[int, int, float]:
        """Return the transforms before and after a time, and the part of the way from one to the other."""
        last = len(self.times) - 1
        if self.static:
            return last, last, 0.0
        after = bisect_left(self.times, time)
        if not 0 < after <= last:
            after = min(after, last)
            return after, after, 0.0
        start, stop = self.times[after - 1], self.times[after]
        return after - 1, after, (time - start) / (stop - start)


class _Path:
    """The transforms from one frame to another: down from their common ancestor, and up to it.

    Attributes
    ----------
    start, stop : int
        The pose is known from one of these times to the other, nanoseconds since 1970, but for gaps.
    """

    def __init__(self, down: Sequence[_Edge], up: Sequence[_Edge], beyond: int, fill_gaps: bool) -> None:
        self._edges, self._inverted = (*down, *reversed(up)), len(down)
        for edge in self._edges:
            edge.order()
        moving = [edge for edge in self._edges if not edge.static]
        self.start = max((edge.times[0] - beyond for edge in moving), default=-_EVER)
        self.stop = min((edge.times[-1] + beyond for edge in moving), default=_EVER)
        gaps = [] if fill_gaps else [edge.list_gaps() for edge in moving]
        self._gaps = [(starts + beyond, stops - beyond) for starts, stops in gaps if len(starts)]
        self._fixed = None if moving else self._compose(0)

    def has_pose(self, time: int) -> bool:
        """Tell whether the pose is known at a time."""
        if not self.start <= time <= self.stop:
            return False
        for starts, stops in self._gaps:
            last = int(np.searchsorted(starts, time)) - 1
            if last >= 0 and time < stops[last]:
                return False
        return True

    def find_pose(self, time: int) -> Array:
        """Return the (4, 4) pose at a time."""
        return self._compose(time) if self._fixed is None else self._fixed.copy()

    def _compose(self, time: int) -> Array:
        # all transforms at once, as loops in Python take a minute for frames below a long chain
        befores, afters, parts = array("d"), array("d"), array("d")
        for edge in self._edges:
            before, after, part = edge.find(time)
            befores += edge.values[_NUMBERS * before : _NUMBERS * (before + 1)]
            afters += edge.values[_NUMBERS * after : _NUMBERS * (after + 1)]
            parts.append(part)
        one, other = (np.array(values).reshape(-1, _NUMBERS) for values in (befores, afters))
        motions = make_motions(_interpolate(one, other, np.array(parts)[:, None]))
        motions[: self._inverted] = _invert(motions[: self._inverted])
        while len(motions) > 1:  # neighbours are multiplied, until one motion is left
            alone = motions[len(motions) & ~1 :]
            motions = np.concatenate([motions[:-1:2] @ motions[1::2], alone])
        return motions[0] if len(motions) else np.eye(4)


class Transforms:
    """A tree of static and moving transforms.

    The first and the last transform of a frame hold for `beyond` nanoseconds before and after them, as do
    those beside a gap in which the frame moved. With `fill_gaps`, poses are interpolated across gaps, as tf2
    does. All transforms together take at most `max_bytes` of memory.
    """

    def __init__(self, beyond: int, max_bytes: int, fill_gaps: bool = False) -> None:
        self._beyond, self._max_bytes, self._size = beyond, max_bytes, 0
        self._fill_gaps = fill_gaps
        self._edges: dict[str, _Edge] = {}
        self._parents: set[str] = set()
        self._paths: dict[tuple[str, str], _Path] = {}

    @property
    def size(self) -> int:
        """Memory of all transforms, bytes."""
        return self._size

    @property
    def frames(self) -> list[str]:
        """All frames in alphabetical order."""
        return sorted({*self._edges, *self._parents})

    def add(self, message: Any, static: bool) -> None:
        """Add the transforms of a tf2_msgs/TFMessage; raise ValueError if they are invalid or too many."""
        self._paths.clear()
        for one in message.transforms:
            child, parent = strip_slash(one.child_frame_id), strip_slash(one.header.frame_id)
            if child not in self._edges:
                self._take(_EDGE + 4 * (len(child) + len(parent)))
                self._edges[child] = _Edge(parent, static)
                self._parents.add(parent)
            edge = self._edges[child]
            if edge.parent != parent:
                raise ValueError(f"frame {child!r}: expected one parent, got {edge.parent!r} and {parent!r}")
            motion = read_motion(f"frame {child!r}", one.transform.translation, one.transform.rotation)
            if static:
                self._size -= _TRANSFORM * len(edge.times)
                del edge.times[:], edge.values[:]
            self._take(_TRANSFORM)
            time = read_stamp(one.header)
            edge.ordered &= not edge.times or edge.times[-1] <= time
            edge.times.append(time)
            edge.values.extend(motion)
            edge.gaps = None

    def _take(self, size: int) -> None:
        self._size += size
        if self._size > self._max_bytes:
            raise ValueError("the transforms take more than max_bytes")

    def has_pose(self, world: str, frame: str, time: int) -> bool:
        """Tell whether `find_pose` finds a pose."""
        return self._find_path(world, frame).has_pose(time)

    def find_pose(self, world: str, frame: str, time: int) -> Array | None:
        """Return the (4, 4) pose of a frame in the world frame at a time, or None if TF has none then.

        ValueError is raised if TF lacks one of the frames, or does not connect them.
        """
        path = self._find_path(world, frame)
        return path.find_pose(time) if path.has_pose(time) else None

    def _find_path(self, world: str, frame: str) -> _Path:
        """Return the path from the world to a frame."""
        key = world, frame
        if key not in self._paths:
            if len(self._paths) == _MAX_PATHS:
                self._paths.clear()
            self._paths[key] = self._make_path(strip_slash(world), strip_slash(frame))
        return self._paths[key]

    def _make_path(self, world: str, frame: str) -> _Path:
        for name in (world, frame):
            if world != frame and name not in self._edges and name not in self._parents:
                known = self.frames
                shown = ", ".join(known[:_MAX_LISTED]) + (", ..." if len(known) > _MAX_LISTED else "")
                raise ValueError(f"no frame {name!r} in TF; there are {shown or 'none'}")
        above, path = self._list_ancestors(world), self._list_ancestors(frame)
        common = next((name for name in path if name in above), None)
        if common is None:
            raise ValueError(f"TF does not connect {frame!r} and {world!r}")
        down, up = ([self._edges[name] for name in takewhile(common.__ne__, each)] for each in (above, path))
        return _Path(down, up, self._beyond, self._fill_gaps)

    def _list_ancestors(self, frame: str) -> dict[str, None]:
        """Return the frame, its parent, and so on up to the root, as keys."""
        path = {frame: None}
        while frame in self._edges:
            frame = self._edges[frame].parent
            if frame in path:
                raise ValueError(f"TF has a circle through {frame!r}")
            if len(path) > _MAX_STEPS:
                first = next(iter(path))
                raise ValueError(f"TF has more than {_MAX_STEPS} frames from {first!r} to the root")
            path[frame] = None
        return path


def strip_slash(name: str) -> str:
    """Return a frame's name without the leading slash that older software writes."""
    return name.removeprefix("/")


def read_motion(name: str, translation: Any, rotation: Any) -> list[float]:
    """Return the translation, metres, and the unit quaternion x, y, z, w of a message's fields."""
    place = [float(getattr(translation, axis)) for axis in "xyz"]
    turn = [float(getattr(rotation, axis)) for axis in "xyzw"]
    norm = math.hypot(*turn)
    near = all(abs(v) < _MAX_TRANSLATION for v in place)
    if not (near and 1.0 - _MAX_NORM_ERROR < norm < 1.0 + _MAX_NORM_ERROR):
        raise ValueError(f"{name}: expected a translation in metres and a unit quaternion")
    return [*place, *(v / norm for v in turn)]


def read_stamp(header: Any) -> int:
    """Return the time of a message's header, nanoseconds since 1970."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def find_gaps(times: array[int], values: array[float]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the times before and after which transforms are missing while the frame moved.

    `times` are in order, nanoseconds. `values` are the seven numbers of `read_motion` for each of them.
    """
    at = np.frombuffer(times, np.int64)
    steps = np.diff(at)
    if not len(steps):
        return steps, steps
    before = np.flatnonzero(steps > max(GAP, _GAP_STEPS * float(np.median(steps))))
    motions = np.frombuffer(values).reshape(-1, _NUMBERS)
    one, other = motions[before], motions[before + 1]
    ways = np.linalg.norm(other[:, :3] - one[:, :3], axis=1)
    turns = 2.0 * np.arccos(np.minimum(np.abs((one[:, 3:] * other[:, 3:]).sum(axis=1)), 1.0))
    before = before[(ways > _STILL[0]) | (turns > _STILL[1])]
    return at[before], at[before + 1]


def _interpolate(one: Array, other: Array, parts: Array) -> Array:
    """Return the translations and quaternions at (N, 1) parts of the way, by lerp and slerp."""
    p, q = one[:, 3:], other[:, 3:]
    cosines = (p * q).sum(axis=1, keepdims=True)
    q = np.where(cosines < 0.0, -q, q)
    angles = np.arccos(np.minimum(np.abs(cosines), 1.0))
    # nearly equal rotations are interpolated linearly
    curved = angles > _MIN_ANGLE
    before = np.where(curved, np.sin((1.0 - parts) * angles), 1.0 - parts)
    after = np.where(curved, np.sin(parts * angles), parts)
    turns = before * p + after * q
    turns /= np.sqrt((turns * turns).sum(axis=1, keepdims=True))
    return np.hstack([(1.0 - parts) * one[:, :3] + parts * other[:, :3], turns])


def make_motions(values: Array) -> Array:
    """Return (N, 4, 4) motions of translations and unit quaternions x, y, z, w."""
    motions = np.zeros((len(values), 4, 4))
    x, y, z, w = values[:, 3:].T
    motions[:, :3, :3] = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    motions[:, :3, 3] = values[:, :3]
    motions[:, 3, 3] = 1.0
    return motions


def _invert(motions: Array) -> Array:
    """Return the (N, 4, 4) inverse motions."""
    back = np.zeros_like(motions)
    turns = motions[:, :3, :3].transpose(0, 2, 1)
    back[:, :3, :3] = turns
    back[:, :3, 3:] = -turns @ motions[:, :3, 3:]
    back[:, 3, 3] = 1.0
    return back
