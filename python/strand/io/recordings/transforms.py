"""Where frames are to each other at a time: a tree of transforms as TF records them."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

TF_KINDS = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_BYTES = 64  # of one transform
_FARTHEST = 1e9  # metres: the moon is nearer
_SHOWN = 20  # frames that a message names


@dataclass
class _Edge:
    """The transforms of a frame to its parent.

    Attributes
    ----------
    parent : str
    static : bool
        Whether it holds at any time.
    times : array of int
        Nanoseconds since 1970.
    values : array of float
        Translation, metres, and unit quaternion x, y, z, w of each.
    """

    parent: str
    static: bool
    times: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))


class Transforms:
    """A tree of transforms, some of them moving.

    Parameters
    ----------
    beyond : int
        For how long before the first and after the last transform of a frame these hold, nanoseconds.
    max_bytes : int
        How much memory they may take.
    """

    def __init__(self, beyond: int, max_bytes: int) -> None:
        self._beyond, self._most = beyond, max_bytes // _BYTES
        self._edges: dict[str, _Edge] = {}
        self._sorted: dict[str, tuple[NDArray[np.int64], Array]] = {}

    @property
    def frames(self) -> list[str]:
        """All frames, in alphabetical order."""
        return sorted({*self._edges, *(edge.parent for edge in self._edges.values())})

    def add(self, message: Any, static: bool) -> None:
        """Take the transforms of a tf2_msgs/TFMessage.

        Raises
        ------
        ValueError
            If one is no rigid motion, a frame has two parents, or there are too many.
        """
        for one in message.transforms:
            child, parent = strip_slash(one.child_frame_id), strip_slash(one.header.frame_id)
            edge = self._edges.setdefault(child, _Edge(parent, static))
            if edge.parent != parent:
                raise ValueError(f"frame {child!r}: expected one parent, got {edge.parent!r} and {parent!r}")
            t, q = one.transform.translation, one.transform.rotation
            place, turn = [float(v) for v in (t.x, t.y, t.z)], [float(v) for v in (q.x, q.y, q.z, q.w)]
            norm = math.hypot(*turn)
            if not (all(abs(v) < _FARTHEST for v in place) and 0.99 < norm < 1.01):
                raise ValueError(f"frame {child!r}: expected a translation in metres and a unit quaternion")
            if static:
                del edge.times[:], edge.values[:]
            self._most -= 1
            if self._most < 0:
                raise ValueError("more transforms than max_bytes holds")
            edge.times.append(read_stamp(one.header))
            edge.values.extend([*place, *(v / norm for v in turn)])

    def find_pose(self, world: str, frame: str, time: int) -> Array | None:
        """(4, 4) Motion from a frame to the world at a time; None if it is not known then.

        Raises
        ------
        ValueError
            If a frame is not there, or none leads from one to the other.
        """
        world, frame = strip_slash(world), strip_slash(frame)
        known = self.frames
        for name in (world, frame):
            if name not in known and world != frame:
                shown = ", ".join(known[:_SHOWN]) + (", ..." if len(known) > _SHOWN else "")
                raise ValueError(f"no frame {name!r} in TF; there are {shown or 'none'}")
        above = {name: i for i, name in enumerate(self._ancestors(world))}
        path = self._ancestors(frame)
        common = next((name for name in path if name in above), None)
        if common is None:
            raise ValueError(f"TF does not connect {frame!r} and {world!r}")
        up = self._to_ancestor(frame, common, time)
        down = self._to_ancestor(world, common, time)
        return None if up is None or down is None else np.asarray(_inverse(down) @ up)

    def _ancestors(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on."""
        path = [frame]
        while path[-1] in self._edges:
            parent = self._edges[path[-1]].parent
            if parent in path:
                raise ValueError(f"TF leads from {parent!r} back to it")
            path.append(parent)
        return path

    def _to_ancestor(self, frame: str, ancestor: str, time: int) -> Array | None:
        motion = np.eye(4)
        while frame != ancestor:
            step = self._at(frame, time)
            if step is None:
                return None
            motion, frame = step @ motion, self._edges[frame].parent
        return motion

    def _at(self, frame: str, time: int) -> Array | None:
        """(4, 4) Motion to the parent: between two transforms, in a straight line and an even turn."""
        edge = self._edges[frame]
        if frame not in self._sorted:
            times = np.array(edge.times, dtype=np.int64)
            order = np.argsort(times, kind="stable")
            self._sorted[frame] = times[order], np.array(edge.values).reshape(-1, 7)[order]
        times, values = self._sorted[frame]
        if edge.static:
            return _motion(values[-1])
        if not times[0] - self._beyond <= time <= times[-1] + self._beyond:
            return None
        after = int(np.searchsorted(times, time))
        if after in (0, len(times)) or times[after] == time:
            return _motion(values[min(after, len(times) - 1)])
        start, stop = int(times[after - 1]), int(times[after])
        return _motion(_between(values[after - 1], values[after], (time - start) / (stop - start)))


def strip_slash(name: str) -> str:
    """Return a frame's name without the slash that older software writes before it."""
    return name.removeprefix("/")


def read_stamp(header: Any) -> int:
    """Nanoseconds since 1970 of a message's header."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def _between(one: Array, other: Array, part: float) -> Array:
    p, q = one[3:], other[3:]
    cosine = float(p @ q)
    q = q if cosine >= 0.0 else -q
    angle = np.arccos(min(abs(cosine), 1.0))
    if angle > 1e-6:
        turn = (np.sin((1.0 - part) * angle) * p + np.sin(part * angle) * q) / np.sin(angle)
    else:
        turn = (1.0 - part) * p + part * q
    return np.concatenate([(1.0 - part) * one[:3] + part * other[:3], turn / np.linalg.norm(turn)])


def _motion(value: Array) -> Array:
    """(4, 4) Of a translation and a unit quaternion x, y, z, w."""
    motion = np.eye(4)
    x, y, z, w = value[3:].tolist()
    motion[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    motion[:3, 3] = value[:3]
    return motion


def _inverse(motion: Array) -> Array:
    back = np.eye(4)
    back[:3, :3] = motion[:3, :3].T
    back[:3, 3] = -motion[:3, :3].T @ motion[:3, 3]
    return back
