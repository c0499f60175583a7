"""Recordings: frames of one or several depth cameras from a bag, one in memory at a time."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES
from strand.io.recordings.bags import Bag, Message
from strand.io.recordings.message_views import make_view
from strand.io.recordings.synchronization import match_messages
from strand.io.recordings.topics import choose_topics, read_camera
from strand.io.recordings.transforms import TF_KINDS, Transforms, read_stamp
from strand.support.checks import (
    Array,
    check_bool,
    check_integer,
    check_intrinsics,
    check_nonnegative,
    check_positive,
    check_rigid_motion,
    check_sequence,
    check_text,
)
from strand.support.files import FileFormatError
from strand.support.lazy import lazy_property
from strand.views.view import View

TOLERANCE = 0.02
"""How far apart in time the views of a frame may be, seconds: half a frame at 25 Hz."""

_SECOND = 10**9
_LONG = 1e9  # seconds; longer ones are no different, and nanoseconds have to fit in 64 bits


@dataclass(frozen=True, eq=False)
class Frame:
    """What the cameras saw at one time.

    Attributes
    ----------
    number : int
        Which frame of the recording it is, from 0.
    stamp : int
        When the first camera saw it, nanoseconds since 1970, as ROS has it.
    views : tuple of View
        One for each topic, in the order of `Recording.topics`.
    """

    number: int
    stamp: int
    views: tuple[View, ...]

    @property
    def time(self) -> float:
        """The time stamp, seconds since 1970."""
        return self.stamp / _SECOND


@dataclass(frozen=True, eq=False)
class UndecodedFrame:
    """A frame whose messages were read, but not decoded.

    Attributes
    ----------
    number : int
        Which frame of the recording it is, from 0.
    messages : tuple of Message
        One for each topic.
    """

    number: int
    messages: tuple[Message, ...]


class Recording:
    """A ROS 1 bag, ROS 2 bag or MCAP file, read frame by frame; a context that closes the file.

    Each message of the first topic makes a frame, together with the messages of the other topics that are
    nearest in time. Iteration gives the frames in the order of the first topic; only messages of the topics
    are decoded, and one frame is in memory at a time. ROS is not needed; rosbags is.

    Parameters
    ----------
    path : str or path-like
        A `.bag` file of ROS 1 (RealSense's recordings are such), an `.mcap` or `.db3` file, or the folder of
        a ROS 2 bag.
    topics : sequence of str, optional
        Topics with depth, one for each camera: Image (16UC1, 32FC1), CompressedImage ("compressedDepth"
        with a PNG) or PointCloud2. `*` stands for any text, `?` for a letter. If not given, the only one that
        shows depth: depth images before points.
    world : str, optional
        The TF frame that is the world frame. Frames at times at which TF does not say where all cameras were
        are left out.
    poses : sequence of (4, 4) array_like, optional
        Camera-to-world poses that do not change, one for each topic, instead of TF. With neither, the
        only camera's frame is the world frame.
    tolerance : float
        How far apart in time the views of a frame may be, and how long TF's first and last transforms hold
        before and after them, seconds; 0.02 if not given.
    intrinsics : (3, 3) array_like, optional
        The pinhole matrix of all depth images, pixels; if not given, each topic's CameraInfo beside it says
        it. Rectified images ("image_rect") are seen by P, others by K.
    depth_scale : float, optional
        Metres for each unit of depth images of 16 bits; if not given, what a file of RealSense's says, and
        else 0.001.
    ignore_distortion : bool
        Take images of lenses that distort as they are. They are refused otherwise.
    max_bytes : int
        How much of the file may be in memory at once, and how much a depth image may take; 4 GiB if not
        given.

    Attributes
    ----------
    path : Path
    topics : tuple of str
    files : tuple of Path
        What it is read from.

    Raises
    ------
    OSError
        If the file is missing or cannot be opened.
    strand.FileFormatError
        If it is truncated, damaged, not indexed or no bag, has no depth, or a camera's CameraInfo is missing
        or no pinhole. While frames are read: if a message is damaged.
    TypeError, ValueError
        If an argument is of the wrong kind or out of range; there is no such topic or TF frame, or several
        topics and nothing says where their cameras are. The message lists what there is.
    ImportError
        If rosbags, or for compressed depth Pillow, is not installed.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        topics: Sequence[str] | None = None,
        *,
        world: str | None = None,
        poses: Sequence[ArrayLike] | None = None,
        tolerance: float = TOLERANCE,
        intrinsics: ArrayLike | None = None,
        depth_scale: float | None = None,
        ignore_distortion: bool = False,
        max_bytes: int = MAX_BYTES,
    ) -> None:
        self._tolerance = round(min(check_nonnegative("tolerance", tolerance), _LONG) * _SECOND)
        self._world = None if world is None else check_text("world", world)
        if world is not None and poses is not None:
            raise ValueError("poses: expected none along with world, which takes them from TF")
        patterns = (
            None
            if topics is None
            else [check_text("topics", one) for one in check_sequence("topics", topics, "text")]
        )
        camera = None if intrinsics is None else check_intrinsics("intrinsics", intrinsics)
        scale = None if depth_scale is None else check_positive("depth_scale", depth_scale)
        ignore = check_bool("ignore_distortion", ignore_distortion)
        self._max_bytes = check_integer("max_bytes", max_bytes, 1)
        self.path = Path(path)
        self._bag = Bag(self.path, self._max_bytes)
        try:
            self.files = self._bag.files
            self.topics = choose_topics(self._bag, patterns)
            self._poses = _fixed(poses, self.topics, world)
            self._cameras = {
                topic: read_camera(self._bag, topic, camera, scale, ignore) for topic in self.topics
            }
            if self._world is not None:
                self._require_frames(self._world)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._bag.close()

    def __len__(self) -> int:
        """How many frames there are; the time stamps of the whole file are read once for it."""
        return len(self.stamps)

    @property
    def most_frames(self) -> int:
        """How many frames there are at most: messages of the first topic, as the index counts them."""
        return self._bag.counts[self.topics[0]]

    @property
    def stamps(self) -> NDArray[np.int64]:
        """(F,) Time stamps of the frames, nanoseconds since 1970; the whole file is read once for them."""
        return self._plan[0]

    def __iter__(self) -> Iterator[Frame]:
        return self.read()

    def read(self, start: int = 0, stop: int | None = None, step: int = 1) -> Iterator[Frame]:
        """Go through some of the frames; the others are not decoded.

        Parameters
        ----------
        start : int
            The first frame.
        stop : int, optional
            The frame before which to end; if not given, the last one is read too.
        step : int
            Every how many frames one is read.

        Raises
        ------
        TypeError, ValueError
            If a number is none, is negative, or `step` is 0.
        strand.FileFormatError
            If a message of a frame is damaged.
        """
        return (self.decode(each) for each in self.read_undecoded(start, stop, step))

    def read_undecoded(
        self, start: int = 0, stop: int | None = None, step: int = 1
    ) -> Iterator[UndecodedFrame]:
        """Go through some of the frames before they are decoded: what is damaged in one spoils no other.

        Parameters
        ----------
        start, stop, step : int
            As for `read`.

        Raises
        ------
        TypeError, ValueError
            As `read`.
        strand.FileFormatError
            If the file itself is damaged.
        """
        start, step = check_integer("start", start), check_integer("step", step, 1)
        stop = None if stop is None else check_integer("stop", stop)
        if len(self.topics) == 1 and self._world is None:
            return self._each(start, stop, step)
        return self._planned(range(len(self))[start:stop:step])

    def _each(self, start: int, stop: int | None, step: int) -> Iterator[UndecodedFrame]:
        """Frames of one topic, without a look at the whole file first."""
        for number, message in enumerate(self._bag.read_messages(self.topics)):
            if stop is not None and number >= stop:
                return
            if number >= start and (number - start) % step == 0:
                yield UndecodedFrame(number, (message,))

    def _planned(self, numbers: range) -> Iterator[UndecodedFrame]:
        """Frames of which is known what they consist of; messages are held until their last frame is made."""
        parts = self._plan[1]
        left = Counter((k, int(n)) for number in numbers for k, n in enumerate(parts[number]))
        held: dict[tuple[int, int], Message] = {}
        counts = [0] * len(self.topics)
        size, due = 0, iter(numbers)
        number = next(due, None)
        messages = self._bag.read_messages(self.topics)
        while number is not None:
            needed = [(k, int(n)) for k, n in enumerate(parts[number])]
            while not all(key in held for key in needed):
                message = next(messages, None)
                if message is None:
                    raise FileFormatError(self.path, "messages are gone that were there before")
                k = self.topics.index(message.topic)
                key = (k, counts[k])
                counts[k] += 1
                if left[key]:
                    held[key] = message
                    size += len(message.data)
                if size > self._max_bytes:
                    reason = f"views of one time lie more than max_bytes={self._max_bytes} apart in the file"
                    raise FileFormatError(self.path, reason, message.place)
            frame = UndecodedFrame(number, tuple(held[key] for key in needed))
            for key in needed:
                left[key] -= 1
                if not left[key]:
                    size -= len(held.pop(key).data)
            yield frame
            number = next(due, None)

    def decode(self, frame: UndecodedFrame) -> Frame:
        """Decode a frame.

        Raises
        ------
        strand.FileFormatError
            If one of its messages is damaged.
        """
        decoded = [self._bag.decode(message) for message in frame.messages]
        views = []
        for k, (message, seen) in enumerate(zip(frame.messages, decoded, strict=True)):
            camera = self._cameras[message.topic]
            pose = self._pose(k, seen.header.frame_id, self._stamp(message, seen))
            try:
                view = make_view(seen, camera.pinhole, pose, camera.depth_scale, self._max_bytes)
            except (TypeError, ValueError) as error:
                raise FileFormatError(self.path, str(error), message.place) from error
            views.append(view)
        return Frame(frame.number, self._stamp(frame.messages[0], decoded[0]), tuple(views))

    def _pose(self, k: int, frame: str, stamp: int) -> Array | None:
        if self._world is None:
            return self._poses[k]
        return self._transforms.find_pose(self._world, frame, stamp)

    @staticmethod
    def _stamp(message: Message, decoded: Any) -> int:
        """When it was seen; when it was recorded, if the message does not say that."""
        return read_stamp(decoded.header) or message.time

    @lazy_property
    def _plan(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(F,) Time stamps of the frames, and (F, T) numbers of the messages that each consists of."""
        times: dict[str, list[int]] = {topic: [] for topic in self.topics}
        frames: dict[str, list[str]] = {topic: [] for topic in self.topics}
        for message in self._bag.read_messages(self.topics):
            decoded = self._bag.decode(message)
            times[message.topic].append(self._stamp(message, decoded))
            frames[message.topic].append(decoded.header.frame_id)
        stamps = [np.array(times[topic], dtype=np.int64) for topic in self.topics]
        parts = match_messages(stamps, self._tolerance)
        if not len(parts):
            reason = f"no frame: never were messages of all topics within {self._tolerance / _SECOND:g} s"
            raise FileFormatError(self.path, reason, ", ".join(self.topics))
        if self._world is not None:
            placed = [
                all(
                    self._pose(k, frames[topic][n], times[topic][n]) is not None
                    for k, (topic, n) in enumerate(zip(self.topics, row, strict=True))
                )
                for row in parts.tolist()
            ]
            parts = parts[np.array(placed, dtype=bool)]
            if not len(parts):
                reason = f"no frame: TF says at none of {len(placed)} times where all cameras were"
                raise FileFormatError(self.path, reason, ", ".join(self.topics))
        kept = stamps[0][parts[:, 0]]
        kept.setflags(write=False)
        return kept, parts

    @lazy_property
    def _transforms(self) -> Transforms:
        found = Transforms(self._tolerance, self._max_bytes)
        for message in self._bag.read_messages(self._bag.find_topics(*TF_KINDS)):
            try:
                found.add(self._bag.decode(message), static=message.topic.endswith("tf_static"))
            except ValueError as error:
                raise FileFormatError(self.path, str(error), message.place) from error
        return found

    def _require_frames(self, world: str) -> None:
        """Refuse a world frame that TF does not lead to from every camera."""
        for topic in self.topics:
            first = self._bag.read_first(topic)
            if first is not None:
                try:
                    self._transforms.find_pose(world, self._bag.decode(first).header.frame_id, first.time)
                except FileFormatError:
                    raise
                except ValueError as error:
                    raise ValueError(f"world: {self.path}: {topic}: {error}") from error


def _fixed(poses: Sequence[ArrayLike] | None, topics: Sequence[str], world: str | None) -> list[Array | None]:
    """Poses that do not change, one for each topic."""
    if poses is None:
        if len(topics) > 1 and world is None:
            raise ValueError(
                f"world: {len(topics)} cameras need a TF frame (--world) or poses= to say where they are"
            )
        return [None] * len(topics)
    given = check_sequence("poses", poses, "matrices")
    if len(given) != len(topics):
        raise ValueError(f"poses: expected one for each of {len(topics)} topics, got {len(given)}")
    return [check_rigid_motion(f"poses[{i}]", pose) for i, pose in enumerate(given)]
