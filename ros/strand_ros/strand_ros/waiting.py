"""Messages wait here until all that belongs to a depth image has arrived, in bounded memory."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.stamps import SECOND

_JUMP = 1.0  # s: a stamp that is earlier by more means that time began anew, as when a bag is played again

FindPose = Callable[[str, Any], NDArray[np.float64]]
"""Returns the (4, 4) camera-to-world pose for a TF frame and a stamp; raises LookupError until TF has it."""


@dataclass(frozen=True, eq=False)
class Frame:
    """A depth image with all that belongs to it: its CameraInfo, pose, colours and masks by name.

    `fresh` tells whether time began anew with it.
    """

    depth: Any
    info: Any
    pose: NDArray[np.float64] | None
    images: dict[str, Any]
    fresh: bool


@dataclass(frozen=True)
class Dropped:
    """A depth image that is not used: the kind of reason, and the reason in words."""

    kind: str
    reason: str


@dataclass(eq=False)
class _Waiting:
    depth: Any
    stamp: int
    arrived: float
    fresh: bool
    missing: Dropped = field(default_factory=lambda: Dropped("queue", ""))


class WaitingRoom:
    """Pairs depth images with colours, masks, CameraInfo and poses.

    Parameters
    ----------
    needed : sequence of str
        What each depth image needs beside its CameraInfo: "color", "mask", "occluders".
    tolerance : float
        Largest difference of stamps in a pair, s.
    patience : float
        How long a depth image waits, s.
    most : int
        How many images of each kind wait, at most.
    find_pose : callable, optional
        Gives the pose; without it, the camera's frame is the world.
    newest : bool
        Whether complete depth images are dropped for a newer one.
    """

    def __init__(
        self,
        needed: Sequence[str],
        tolerance: float,
        patience: float,
        most: int,
        find_pose: FindPose | None = None,
        newest: bool = False,
    ) -> None:
        self._tolerance, self._patience = round(tolerance * SECOND), patience
        self._most, self._find_pose, self._newest = most, find_pose, newest
        self._depths: deque[_Waiting] = deque()
        self._images: dict[str, deque[tuple[int, Any]]] = {name: deque(maxlen=most) for name in needed}
        self._info: Any = None
        self._last: int | None = None
        self._fresh = False

    def __len__(self) -> int:
        return len(self._depths) + sum(map(len, self._images.values()))

    def set_info(self, message: Any) -> None:
        """Take a CameraInfo. The latest is used."""
        self._info = message

    def add_image(self, name: str, message: Any) -> None:
        """Take an image that depth may need."""
        self._images[name].append((read_stamp(message), message))

    def add_depth(self, message: Any, now: float) -> list[Dropped]:
        """Take a depth image at a time, s, of a clock that never goes back; return what is dropped for it."""
        stamp = read_stamp(message)
        if stamp == 0:
            return [Dropped("stamp", "expected depth images with a stamp, got one of 0")]
        dropped = []
        if self._last is not None and stamp <= self._last:
            behind = (self._last - stamp) / SECOND
            if behind <= _JUMP:
                return [Dropped("late", f"a depth image came {behind:.3f} s behind a later one")]
            dropped = [Dropped("jump", f"stamps went back by {behind:.3f} s: all begins anew")]
            dropped += [Dropped("jump", "it is of the time before the jump") for _ in self._depths]
            self._depths.clear()
            for name, images in self._images.items():
                kept = [(one, image) for one, image in images if one <= stamp + self._tolerance]
                self._images[name] = deque(kept, maxlen=self._most)
            self._fresh = True
        self._last = stamp
        if len(self._depths) == self._most:
            first = self._depths.popleft()
            self._fresh |= first.fresh
            reason = f"over {self._most} depth images wait; {first.missing.reason or 'the node is too slow'}"
            dropped.append(Dropped("queue", reason))
        self._depths.append(_Waiting(message, stamp, now, self._fresh))
        self._fresh = False
        return dropped

    def take(self, now: float) -> list[Frame | Dropped]:
        """Return the depth images, in their order, that are complete or have waited too long."""
        done: list[Frame | Dropped] = []
        while self._depths:
            first = self._depths[0]
            over = now - first.arrived >= self._patience
            found = self._complete(first, over)
            if isinstance(found, Dropped):
                if not over and not self._is_final(found.kind, first.stamp):
                    first.missing = found
                    break
                self._depths.popleft()
                self._pass_on(first)
            else:
                self._depths.popleft()
            done.append(found)
        return self._keep_newest(done) if self._newest else done

    @staticmethod
    def _keep_newest(done: Sequence[Frame | Dropped]) -> list[Frame | Dropped]:
        """Return the last frame, and drop those before it."""
        frames = [one for one in done if isinstance(one, Frame)]
        kept: list[Frame | Dropped] = [one for one in done if isinstance(one, Dropped)]
        kept += [Dropped("skipped", "a newer depth image was there")] * (len(frames) - 1)
        fresh = any(frame.fresh for frame in frames)
        return kept + [replace(frame, fresh=fresh) for frame in frames[-1:]]

    def _is_final(self, kind: str, stamp: int) -> bool:
        """Tell whether what is missing will not come: messages come in order of their stamps."""
        if kind in self._images:
            return any(one >= stamp + self._tolerance for one, _ in self._images[kind])
        if kind == "tf" and len(self._depths) > 1:
            return not isinstance(self._ask_pose(self._depths[-1].depth.header), Dropped)
        return kind == "bad tf"

    def _ask_pose(self, header: Any) -> NDArray[np.float64] | Dropped | None:
        """Return the pose for a depth image's header, or why there is none."""
        if self._find_pose is None:
            return None
        try:
            return self._find_pose(header.frame_id, header.stamp)
        except LookupError as error:
            return Dropped("tf", str(error))
        except ValueError as error:
            return Dropped("bad tf", str(error))

    def _pass_on(self, dropped: _Waiting) -> None:
        """Let the next image say that time began anew, if one did that is dropped."""
        if dropped.fresh and self._depths:
            self._depths[0].fresh = True
        elif dropped.fresh:
            self._fresh = True

    def _complete(self, waiting: _Waiting, over: bool) -> Frame | Dropped:
        """Return a depth image with all that it needs, or what is missing; `over`: it waits no longer."""
        if self._info is None:
            return Dropped("camera info", "no CameraInfo has come")
        images = {}
        for name in self._images:
            nearest = self._find_nearest(name, waiting.stamp, over)
            if nearest is None:
                tolerance = self._tolerance / SECOND
                return Dropped(name, f"no {name} within {tolerance:g} s of a depth image")
            images[name] = nearest
        pose = self._ask_pose(waiting.depth.header)
        if isinstance(pose, Dropped):
            return pose
        return Frame(waiting.depth, self._info, pose, images, waiting.fresh)

    def _find_nearest(self, name: str, stamp: int, over: bool) -> Any:
        """Return the image nearest in time, if it is near enough, and unless a nearer one may come."""
        near = [(abs(one - stamp), i) for i, (one, _) in enumerate(self._images[name])]
        distance, place = min(near, default=(self._tolerance + 1, 0))
        settled = over or not distance or any(one >= stamp for one, _ in self._images[name])
        return self._images[name][place][1] if settled and distance <= self._tolerance else None


def read_stamp(message: Any) -> int:
    """Return the time of a message's header, nanoseconds."""
    stamp = message.header.stamp
    return int(stamp.sec) * SECOND + int(stamp.nanosec)
