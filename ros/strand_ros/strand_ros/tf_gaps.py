"""Gaps of TF in which a frame moved: tf2 interpolates across them, and its poses are then wrong."""

from __future__ import annotations

from array import array
from collections import deque
from dataclasses import dataclass, field
from threading import Lock
from typing import Any

from strand.io.recordings.transforms import GAP, find_gaps, read_motion, read_stamp, strip_slash

_STEPS = 100  # transforms of a frame from which the usual time between two is taken
_GAPS = 100  # gaps of a frame that are kept
_MAX_ABOVE = 64  # frames between a frame and the root, as in recordings


@dataclass(eq=False)
class _Link:
    """The last transforms from a frame to its parent, and the gaps between them, nanoseconds."""

    parent: str
    times: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    gaps: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_GAPS))

    def add(self, time: int, motion: list[float]) -> None:
        """Take a transform, and note the gap before it."""
        if self.times and time <= self.times[-1]:
            return
        self.times.append(time)
        self.values.extend(motion)
        if len(self.times) > 1 and time - self.times[-2] > GAP:
            starts, stops = find_gaps(self.times, self.values)
            if len(stops) and stops[-1] == time:
                self.gaps.append((int(starts[-1]), time))
        if len(self.times) > 2 * _STEPS:
            del self.times[:-_STEPS], self.values[: -_STEPS * len(motion)]


class TransformGaps:
    """Finds gaps by the rule of recordings: long times between two transforms, in which the frame moved.

    Threads may share it.
    """

    def __init__(self) -> None:
        self._links: dict[str, _Link] = {}
        self._lock = Lock()

    def clear(self) -> None:
        """Forget all gaps."""
        with self._lock:
            self._links = {child: _Link(link.parent) for child, link in self._links.items()}

    def add(self, transform: Any, static: bool) -> None:
        """Take a geometry_msgs/TransformStamped; one that is no motion has no effect, as in tf2."""
        child, parent = strip_slash(transform.child_frame_id), strip_slash(transform.header.frame_id)
        try:
            motion = read_motion(child, transform.transform.translation, transform.transform.rotation)
        except ValueError:
            return
        with self._lock:
            link = self._links.get(child)
            if link is None or link.parent != parent:
                link = self._links[child] = _Link(parent)
            if not static:
                link.add(read_stamp(transform.header), motion)

    def find(self, world: str, frame: str, time: int) -> tuple[str, float] | None:
        """Return the frame that moved in a gap around a time, nanoseconds, and the gap's length, s.

        Gaps of frames between `world` and `frame` count. None is returned without one.
        """
        with self._lock:
            above, below = self._list_ancestors(strip_slash(world)), self._list_ancestors(strip_slash(frame))
            for name in {*above} ^ {*below}:
                link = self._links.get(name)
                for start, stop in link.gaps if link else ():
                    if start < time < stop:
                        return name, (stop - start) / 1e9
        return None

    def _list_ancestors(self, frame: str) -> list[str]:
        """Return the frame, its parent, and so on."""
        found = [frame]
        while frame in self._links and len(found) <= _MAX_ABOVE:
            frame = self._links[frame].parent
            found.append(frame)
        return found
