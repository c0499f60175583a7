"""Read frames of one or several depth cameras from a bag, one in memory at a time."""

from __future__ import annotations

import os
import sys
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.io.budget import MAX_BYTES, Budget
from strand.io.recordings.bags import Bag
from strand.io.recordings.color_alignment import align_colors
from strand.io.recordings.color_messages import decode_color_message
from strand.io.recordings.color_pairing import pair_colors
from strand.io.recordings.color_topics import find_color_cameras, find_color_pose
from strand.io.recordings.frames import Frame, UndecodedFrame
from strand.io.recordings.message import MESSAGE_BYTES, Message
from strand.io.recordings.message_views import FindColors, make_view
from strand.io.recordings.synchronization import find_last_uses, find_nearest, match_messages
from strand.io.recordings.topics import choose_topics, read_depth_topic
from strand.io.recordings.transforms import TF_KINDS, Transforms, read_stamp
from strand.support.checks import (
    Array,
    check_bool,
    check_instance,
    check_integer,
    check_intrinsics,
    check_nonnegative,
    check_path,
    check_positive,
    check_rigid_motion,
    check_sequence,
    check_text,
)
from strand.support.files import FileFormatError
from strand.support.lazy import lazy_property
from strand.support.stamps import SECOND

TOLERANCE = 0.02  # seconds between the views of a frame, at most: half a frame at 25 Hz

_MATCHING = 64  # bytes of a message of the first topic for each topic while frames are found
_PART = 24  # bytes of a topic's message and colour message in the plan of a frame
_PLAN_BYTES = 128  # memory of a message's part of the plan while it is made
_MAX_TOLERANCE = 1e9  # seconds: its nanoseconds fit in 64 bits


class Recording:
    """A ROS 1 bag, ROS 2 bag or MCAP file, read frame by frame; use it in a `with` statement.

    Each message of the first topic makes a frame with the nearest message in time of every other topic.
    Iteration yields the frames in the order of the first topic, and holds one in memory. ROS is
    not needed.

    Depth images get the colours of the nearest colour image in time, within `tolerance`, if there is one. If
    it is from another camera, each depth pixel's point is projected into it by TF and the CameraInfo.

    Parameters
    ----------
    path : str or path-like
        A `.bag` file of ROS 1 (RealSense records these), an `.mcap` or `.db3` file, or the folder of a ROS
        2 bag.
    topics : sequence of str, optional
        One topic with depth for each camera: Image (16UC1, 32FC1), CompressedImage ("compressedDepth" with
        a PNG) or PointCloud2. `*` matches any text, `?` any letter. By default, the only topic that shows
        depth; depth images are preferred to points.
    world : str, optional
        The TF frame that becomes the world frame. Frames for which TF lacks the pose of a camera are dropped.
    poses : sequence of (4, 4) array_like, optional
        One fixed camera-to-world pose for each topic, instead of TF. Without `world` and `poses`, the frame
        of the only camera is the world frame.
    tolerance : float
        Largest difference in time between the views of a frame, seconds; 0.02 by default. TF's first and last
        transforms hold this long before and after them.
    intrinsics : (3, 3) array_like, optional
        The pinhole matrix of all depth images, pixels. By default, each topic's CameraInfo gives it: P for
        rectified images ("image_rect"), K for others.
    depth_scale : float, optional
        Metres per unit of 16-bit depth images. By default, the unit in a RealSense file, else 0.001.
    color_topics : sequence of str, optional
        One topic with colours for each topic: Image (rgb8, bgr8, rgba8, bgra8) or CompressedImage (JPEG,
        PNG). An empty sequence: no colours. By default, the topic whose name is nearest to that of the depth
        topic, if it can be aligned.
    ignore_distortion : bool
        Whether to use images of lenses with distortion as they are; by default, they raise an error.
    max_bytes : int
        Memory limit for the decompressed chunks of the file, and for messages, transforms and the views of
        two frames together, bytes; 4 GiB by default.

    Attributes
    ----------
    path : Path
    topics : tuple of str
    color_topics : tuple of (str or None)
        The topic with the colours of each topic; None for none.
    color_troubles : dict of str to str
        For depth topics without colours, why the likeliest colour topic cannot be aligned.
    files : tuple of Path
        The files of the recording.

    Raises
    ------
    OSError
        If the file is missing or cannot be opened.
    strand.FileFormatError
        If the file is truncated, damaged, not indexed or not a bag, has no depth, or a CameraInfo is
        missing or not a pinhole. While frames are read: if a message is damaged.
    TypeError, ValueError
        If an argument is of the wrong type or out of range, a topic or TF frame does not exist, or several
        cameras have no poses. The message lists the topics or frames that exist.
    ImportError
        If lz4 or backports.zstd is not installed for compressed files, or Pillow for compressed images.
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
        color_topics: Sequence[str] | None = None,
        ignore_distortion: bool = False,
        max_bytes: int = MAX_BYTES,
    ) -> None:
        self._tolerance = round(min(check_nonnegative("tolerance", tolerance), _MAX_TOLERANCE) * SECOND)
        self._world = None if world is None else check_text("world", world)
        if world is not None and poses is not None:
            raise ValueError("poses: expected either poses, or world to take them from TF, got both")
        patterns, named = (
            None if given is None else [check_text(name, one) for one in check_sequence(name, given, "text")]
            for name, given in (("topics", topics), ("color_topics", color_topics))
        )
        camera = None if intrinsics is None else check_intrinsics("intrinsics", intrinsics)
        scale = None if depth_scale is None else check_positive("depth_scale", depth_scale)
        ignore = check_bool("ignore_distortion", ignore_distortion)
        self.path = check_path("path", path)
        self._bag = Bag(self.path, check_integer("max_bytes", max_bytes, 1))
        try:
            self.files = self._bag.files
            self.topics = choose_topics(self._bag, patterns)
            self._poses = _check_poses(poses, self.topics, world)
            self._cameras = {
                topic: read_depth_topic(self._bag, topic, camera, scale, ignore) for topic in self.topics
            }
            if self._world is not None:
                self._require_frames(self._world)
            self._colors, self.color_troubles = find_color_cameras(
                self._bag, list(self._cameras.values()), named, self._find_between
            )
            self.color_topics = tuple(
                self._colors[topic].topic if topic in self._colors else None for topic in self.topics
            )
            self._streams = (*self.topics, *dict.fromkeys(one.topic for one in self._colors.values()))
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
        """Return the number of frames; the first call reads the time stamps of the whole file."""
        return len(self.stamps)

    @property
    def most_frames(self) -> int:
        """Upper bound of the number of frames: messages of the first topic, by the index."""
        return self._bag.counts[self.topics[0]]

    @property
    def stamps(self) -> NDArray[np.int64]:
        """(F,) Time stamps of the frames, nanoseconds since 1970; the first access reads the whole file."""
        return self._plan[0]

    def __iter__(self) -> Iterator[Frame]:
        return self.read()

    def read(self, start: int = 0, stop: int | None = None, step: int = 1) -> Iterator[Frame]:
        """Yield some of the frames; the others are not decoded.

        Parameters
        ----------
        start : int
            The first frame.
        stop : int, optional
            The frame after the last one, as in `range`; by default, the end of the recording.
        step : int
            The difference between two frames.

        Raises
        ------
        TypeError, ValueError
            If an argument is not a whole number, is negative, or `step` is 0.
        strand.FileFormatError
            If a message of a frame is damaged.
        """
        return (self.decode(each) for each in self.read_undecoded(start, stop, step))

    def read_undecoded(
        self, start: int = 0, stop: int | None = None, step: int = 1
    ) -> Iterator[UndecodedFrame]:
        """Yield some of the frames as `read` does, but not decoded: a damaged message spoils only its frame.

        FileFormatError is raised only if the file itself is damaged.
        """
        start, step = check_integer("start", start), check_integer("step", step, 1)
        stop = None if stop is None else check_integer("stop", stop)
        if len(self.topics) == 1 and self._world is None:
            return self._read_single_topic(start, stop, step)
        return self._read_planned(range(len(self))[start:stop:step])

    def _read_single_topic(self, start: int, stop: int | None, step: int) -> Iterator[UndecodedFrame]:
        """Yield frames of one topic without a plan, which would read the whole file first."""
        if self._colors:
            wanted = range(start, sys.maxsize if stop is None else max(stop, start), step)
            if not wanted:
                return
            messages = self._bag.read_messages(self._streams)
            pairs = pair_colors(
                messages,
                self.topics[0],
                wanted,
                self._read_stamp,
                self._tolerance,
                self._bag.budget.left // 2,
            )
            for number, message, color, held in pairs:
                yield UndecodedFrame(number, (message,), (color,), held)
            return
        for number, message in enumerate(self._bag.read_messages(self.topics)):
            if stop is not None and number >= stop:
                return
            if number >= start and (number - start) % step == 0:
                yield UndecodedFrame(number, (message,), (None,), message.size)

    def _read_planned(self, numbers: range) -> Iterator[UndecodedFrame]:
        """Yield planned frames; a message is held until the last frame that needs it."""
        parts = self._plan[1]
        # where the stream of each part is
        places = [
            *range(len(self.topics)),
            *(self._streams.index(topic or self.topics[0]) for topic in self.color_topics),
        ]
        streams = {topic: k for k, topic in enumerate(self._streams)}
        last_uses = find_last_uses(parts, places, numbers)
        held: dict[tuple[int, int], Message] = {}
        counts = [0] * len(streams)
        size, due, budget = 0, iter(numbers), self._bag.budget
        number = next(due, None)
        messages = self._bag.read_messages(self._streams)
        while number is not None:
            keys = [(places[k], int(n)) if n >= 0 else None for k, n in enumerate(parts[number])]
            needed = {key for key in keys if key is not None}
            while not all(key in held for key in needed):
                message = next(messages, None)
                if message is None:
                    raise FileFormatError(self.path, "the file changed: a message is missing")
                k = streams[message.topic]
                key = (k, counts[k])
                counts[k] += 1
                if counts[k] <= len(last_uses[k]) and last_uses[k][key[1]] >= number:
                    held[key] = message
                    size += message.size
                if size > budget.left:
                    reason = (
                        f"views of one frame are more than max_bytes={budget.max_bytes} apart in the file"
                    )
                    raise FileFormatError(self.path, reason, message.place)
            found = [None if key is None else held[key] for key in keys]
            count = len(self.topics)
            yield UndecodedFrame(
                number, tuple(one for one in found[:count] if one), tuple(found[count:]), size
            )
            del found
            for key in needed:
                if last_uses[key[0]][key[1]] == number:
                    size -= held.pop(key).size
            number = next(due, None)

    def decode(self, frame: UndecodedFrame) -> Frame:
        """Decode a frame; raise FileFormatError if one of its messages is damaged."""
        check_instance("frame", frame, UndecodedFrame)
        budget = self._bag.budget.copy()
        budget.take(self.path, frame.held, frame.messages[0].place)
        views, stamps = [], []
        for k, message in enumerate(frame.messages):
            seen = self._bag.decode(message)
            stamp = self._get_stamp(message, seen)
            stamps.append(stamp)
            pose = self._find_pose(k, seen.header.frame_id, stamp)
            colors = self._decode_colors(message.topic, frame.colors[k], seen.header.frame_id, stamp, budget)
            camera = self._cameras[message.topic]
            with self._name_place(message):
                calibration, scale = camera.calibration, camera.depth_scale
                views.append(make_view(seen, calibration, pose, scale, budget, colors, stamp / SECOND))
        return Frame(frame.number, stamps[0], tuple(views), tuple(stamps))

    def _decode_colors(
        self, topic: str, message: Message | None, frame: str, stamp: int, budget: Budget
    ) -> FindColors | None:
        """Return the function that finds the colours of a depth image; None without colours."""
        if message is None:
            return None
        camera = self._colors[topic]
        pose = find_color_pose(camera, frame, stamp, self._find_between)
        if pose is None:
            return None
        decoded = self._bag.decode(message)
        size = None if camera.calibration is None else camera.calibration.size
        with self._name_place(message):
            colors = decode_color_message(decoded, budget, size)
        return lambda depth, matrix, left: align_colors(colors, camera, depth, matrix, pose, left)

    @contextmanager
    def _name_place(self, message: Message) -> Iterator[None]:
        """Convert errors about a message to FileFormatError, which names the file and the message."""
        try:
            yield
        except (TypeError, ValueError) as error:
            raise FileFormatError(self.path, str(error), message.place) from error

    def _find_between(self, world: str, frame: str, stamp: int) -> Array | None:
        return self._transforms.find_pose(world, frame, stamp)

    def _find_pose(self, k: int, frame: str, stamp: int) -> Array | None:
        if self._world is None:
            return self._poses[k]
        return self._transforms.find_pose(self._world, frame, stamp)

    @staticmethod
    def _get_stamp(message: Message, decoded: Any) -> int:
        """Return the time stamp of a message, or its time of recording if the stamp is 0."""
        return read_stamp(decoded.header) or message.time

    def _read_stamp(self, message: Message) -> int:
        return self._get_stamp(message, self._bag.decode(message))

    @lazy_property
    def _plan(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """(F,) Time stamps of the frames, and (F, 2 T) numbers of the depth and colour messages of each.

        -1 is no colour message.
        """
        budget = self._bag.budget
        times: dict[str, array[int]] = {topic: array("q") for topic in self._streams}
        frames: dict[str, list[str]] = {topic: [] for topic in self._streams}
        names: dict[str, str] = {}  # each name once
        for message in self._bag.read_messages(self._streams):
            budget.take(self.path, _PLAN_BYTES, message.place)
            decoded = self._bag.decode(message)
            times[message.topic].append(self._get_stamp(message, decoded))
            name = decoded.header.frame_id
            if name not in names:
                budget.take(self.path, MESSAGE_BYTES + len(name), message.place)
            frames[message.topic].append(names.setdefault(name, name))
        stamps = [np.array(times[topic], dtype=np.int64) for topic in self.topics]
        with budget.hold(self.path, _MATCHING * len(stamps[0]) * len(stamps)):
            parts = match_messages(stamps, self._tolerance)
        budget.take(self.path, _PART * parts.size)
        if not len(parts):
            reason = f"no frame: messages of all topics are never within {self._tolerance / SECOND:g} s"
            raise FileFormatError(self.path, reason, ", ".join(self.topics))
        if self._world is not None:
            placed = [
                all(
                    self._transforms.has_pose(self._world, frames[topic][n], times[topic][n])
                    for topic, n in zip(self.topics, row.tolist(), strict=True)
                )
                for row in parts
            ]
            parts = parts[np.array(placed, dtype=bool)]
            if not len(parts):
                reason = f"no frame: TF lacks the pose of a camera at all of {len(placed)} times"
                raise FileFormatError(self.path, reason, ", ".join(self.topics))
        colors = [
            find_nearest(own[rows], np.array(times[topic], dtype=np.int64), self._tolerance)
            if topic
            else np.full(len(parts), -1)
            for own, rows, topic in zip(stamps, parts.T, self.color_topics, strict=True)
        ]
        parts = np.column_stack([parts, *colors])
        kept = stamps[0][parts[:, 0]]
        kept.setflags(write=False)
        return kept, parts

    @lazy_property
    def _transforms(self) -> Transforms:
        found = Transforms(self._tolerance, self._bag.budget.left)
        for message in self._bag.read_messages(self._bag.find_topics(*TF_KINDS)):
            try:
                found.add(self._bag.decode(message), static=message.topic.endswith("tf_static"))
            except ValueError as error:
                raise FileFormatError(self.path, str(error), message.place) from error
        self._bag.budget.take(self.path, found.size)
        return found

    def _require_frames(self, world: str) -> None:
        """Raise ValueError if TF does not connect the world frame with every camera."""
        for topic in self.topics:
            first = self._bag.find_first(topic)
            if first is not None:
                try:
                    self._transforms.find_pose(world, first.message.header.frame_id, first.time)
                except FileFormatError:
                    raise
                except ValueError as error:
                    raise ValueError(f"world: {self.path}: {topic}: {error}") from error


def _check_poses(
    poses: Sequence[ArrayLike] | None, topics: Sequence[str], world: str | None
) -> list[Array | None]:
    """Return one fixed pose for each topic; None for the only camera, or if TF gives the poses."""
    if poses is None:
        if len(topics) > 1 and world is None:
            raise ValueError(
                f"world: {len(topics)} cameras need poses: give world, a TF frame (--world), or poses"
            )
        return [None] * len(topics)
    given = check_sequence("poses", poses, "matrices")
    if len(given) != len(topics):
        raise ValueError(f"poses: expected one for each of {len(topics)} topics, got {len(given)}")
    return [check_rigid_motion(f"poses[{i}]", pose) for i, pose in enumerate(given)]
