"""Find the pose of one frame in another at a given time, from TF's tree of transforms."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

TF_KINDS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_TRANSFORM = 160  # bytes of a transform, with those of its copy in the order of time
_EDGE = 1024  # bytes of a frame beside its name
_MAX_STEPS = 64  # frames between a frame and the root; robots have up to about 50
_MAX_TRANSLATION = 1e9  # metres: the moon is nearer
_MAX_NORM_ERROR = 0.01  # how far the norm of a quaternion may be from 1
_MIN_ANGLE = 1e-6  # radians: below it, interpolation of rotations is linear
_MAX_LISTED = 20  # frames that an error message names


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
    """

    parent: str
    static: bool
    times: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


class Transforms:
    """A tree of static and moving transforms.

    The first and the last transform of a frame hold for `beyond` nanoseconds before and after them. All
    transforms together take at most `max_bytes` of memory.
    """

    def __init__(self, beyond: int, max_bytes: int) -> None:
        self._beyond, self._max_bytes, self._size = beyond, max_bytes, 0
        self._edges: dict[str, _Edge] = {}
        self._parents: set[str] = set()
        self._sorted: dict[str, tuple[NDArray[np.int64], Array]] = {}

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
        for one in message.transforms:
            child, parent = strip_slash(one.child_frame_id), strip_slash(one.header.frame_id)
            if child not in self._edges:
                self._take(_EDGE + 4 * (len(child) + len(parent)))
                self._edges[child] = _Edge(parent, static)
                self._parents.add(parent)
            edge = self._edges[child]
            if edge.parent != parent:
                raise ValueError(f"frame {child!r}: expected one parent, got {edge.parent!r} and {parent!r}")
            t, q = one.transform.translation, one.transform.rotation
            place, turn = [float(v) for v in (t.x, t.y, t.z)], [float(v) for v in (q.x, q.y, q.z, q.w)]
            norm = math.hypot(*turn)
            near = all(abs(v) < _MAX_TRANSLATION for v in place)
            if not (near and 1.0 - _MAX_NORM_ERROR < norm < 1.0 + _MAX_NORM_ERROR):
                raise ValueError(f"frame {child!r}: expected a translation in metres and a unit quaternion")
            if static:
                self._size -= _TRANSFORM * len(edge.times)
                del edge.times[:], edge.values[:]
            self._take(_TRANSFORM)
            edge.times.append(read_stamp(one.header))
            edge.values.extend([*place, *(v / norm for v in turn)])

    def _take(self, size: int) -> None:
        self._size += size
        if self._size > self._max_bytes:
            raise ValueError("the transforms take more than max_bytes")

    def find_pose(self, world: str, frame: str, time: int) -> Array | None:
        """Return the (4, 4) pose of a frame in the world frame at a time, or None if TF has none then.

        ValueError is raised if TF lacks one of the frames, or does not connect them.
        """
        world, frame = strip_slash(world), strip_slash(frame)
        for name in (world, frame):
            if world != frame and name not in self._edges and name not in self._parents:
                known = self.frames
                shown = ", ".join(known[:_MAX_LISTED]) + (", ..." if len(known) > _MAX_LISTED else "")
                raise ValueError(f"no frame {name!r} in TF; there are {shown or 'none'}")
        above = {name: i for i, name in enumerate(self._list_ancestors(world))}
        path = self._list_ancestors(frame)
        common = next((name for name in path if name in above), None)
        if common is None:
            raise ValueError(f"TF does not connect {frame!r} and {world!r}")
        up = self._compose(frame, common, time)
        down = self._compose(world, common, time)
        return None if up is None or down is None else np.asarray(_invert(down) @ up)

    def _list_ancestors(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on up to the root."""
        path = [frame]
        while path[-1] in self._edges:
            parent = self._edges[path[-1]].parent
            if parent in path:
                raise ValueError(f"TF has a circle through {parent!r}")
            if len(path) > _MAX_STEPS:
                raise ValueError(f"TF has more than {_MAX_STEPS} frames from {frame!r} to the root")
            path.append(parent)
        return path

    def _compose(self, frame: str, ancestor: str, time: int) -> Array | None:
        motion = np.eye(4)
        while frame != ancestor:
            step = self._find_motion(frame, time)
            if step is None:
                return None
            motion, frame = step @ motion, self._edges[frame].parent
        return motion

    def _find_motion(self, frame: str, time: int) -> Array | None:
        """Return the (4, 4) motion to the parent at a time, interpolated between two transforms."""
        edge = self._edges[frame]
        if frame not in self._sorted:
            times = np.array(edge.times, dtype=np.int64)
            order = np.argsort(times, kind="stable")
            self._sorted[frame] = times[order], np.array(edge.values).reshape(-1, 7)[order]
        times, values = self._sorted[frame]
        if edge.static:
            return _make_motion(values[-1])
        if not times[0] - self._beyond <= time <= times[-1] + self._beyond:
            return None
        after = int(np.searchsorted(times, time))
        if after in (0, len(times)) or times[after] == time:
            return _make_motion(values[min(after, len(times) - 1)])
        start, stop = int(times[after - 1]), int(times[after])
        return _make_motion(_interpolate(values[after - 1], values[after], (time - start) / (stop - start)))


def strip_slash(name: str) -> str:
    """Return a frame's name without the leading slash that older software writes."""
    return name.removeprefix("/")


def read_stamp(header: Any) -> int:
    """Return the time of a message's header, nanoseconds since 1970."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def _interpolate(one: Array, other: Array, part: float) -> Array:
    """Return the translation and quaternion at a `part` of the way, by lerp and slerp."""
    p, q = one[3:], other[3:]
    cosine = float(p @ q)
    q = q if cosine >= 0.0 else -q
    angle = np.arccos(min(abs(cosine), 1.0))
    if angle > _MIN_ANGLE:
        turn = (np.sin((1.0 - part) * angle) * p + np.sin(part * angle) * q) / np.sin(angle)
    else:
        turn = (1.0 - part) * p + part * q
    return np.concatenate([(1.0 - part) * one[:3] + part * other[:3], turn / np.linalg.norm(turn)])


def _make_motion(value: Array) -> Array:
    """Return the (4, 4) motion of a translation and a unit quaternion x, y, z, w."""
    motion = np.eye(4)
    x, y, z, w = value[3:].tolist()
    motion[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    motion[:3, 3] = value[:3]
    return motion


def _invert(motion: Array) -> Array:
    back = np.eye(4)
    back[:3, :3] = motion[:3, :3].T
    back[:3, 3] = -motion[:3, :3].T @ motion[:3, 3]
    return back
