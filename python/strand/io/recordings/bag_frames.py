"""The frames of a bag: messages of its topics that belong together in time."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.recordings.bags import Bag
from strand.io.recordings.color_alignment import align_colors
from strand.io.recordings.color_messages import decode_color_message
from strand.io.recordings.color_pairing import pair_colors
from strand.io.recordings.color_topics import find_color_cameras, find_color_pose
from strand.io.recordings.frame_options import FrameOptions, check_poses
from strand.io.recordings.frames import Frame, UndecodedFrame
from strand.io.recordings.message import MESSAGE_BYTES, Message
from strand.io.recordings.message_views import FindColors, make_view
from strand.io.recordings.synchronization import find_last_uses, find_nearest, match_messages
from strand.io.recordings.topics import choose_topics, read_depth_topic
from strand.io.recordings.transforms import TF_KINDS, Transforms, read_stamp, strip_slash
from strand.support.checks import Array
from strand.support.files import FileFormatError
from strand.support.lazy import lazy_property
from strand.support.stamps import SECOND

_MATCHING = 64  # bytes of a message of the first topic for each topic while frames are found
_PART = 24  # bytes of a topic's message and colour message in the plan of a frame
_PLAN_BYTES = 128  # memory of a message's part of the plan while it is made


class BagFrames:
    """The frames of a bag; the attributes and errors are those of `strand.Recording`."""

    def __init__(self, path: Path, options: FrameOptions) -> None:
        self.path = path
        self.episodes: tuple[range, ...] = ()
        self._tolerance, self._world = options.tolerance, options.world
        self._bag = Bag(path, options.max_bytes)
        try:
            self.files = self._bag.files
            self.topics = choose_topics(self._bag, options.topics)
            self._poses = check_poses(options.poses, self.topics, options.world)
            self._cameras = {
                topic: read_depth_topic(
                    self._bag, topic, options.intrinsics, options.depth_scale, options.ignore_distortion
                )
                for topic in self.topics
            }
            if self._world is not None:
                self._require_frames(self._world)
            self._colors, self.color_troubles = find_color_cameras(
                self._bag, list(self._cameras.values()), options.color_topics, self._find_between
            )
            self.color_topics = tuple(
                self._colors[topic].topic if topic in self._colors else None for topic in self.topics
            )
            self._streams = (*self.topics, *dict.fromkeys(one.topic for one in self._colors.values()))
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._bag.close()

    @property
    def frame_id(self) -> str:
        """The frame of the views' world."""
        first = None if self._world or self._poses[0] is not None else self._bag.find_first(self.topics[0])
        own = "" if first is None else strip_slash(first.message.header.frame_id)
        return self._world or own or "world"

    @property
    def most_frames(self) -> int:
        """Upper bound of the number of frames: messages of the first topic, by the index."""
        return self._bag.counts[self.topics[0]]

    @property
    def stamps(self) -> NDArray[np.int64]:
        """(F,) Time stamps of the frames, nanoseconds since 1970; the first access reads the whole file."""
        return self._plan[0]

    def read_undecoded(self, start: int, stop: int | None, step: int) -> Iterator[UndecodedFrame]:
        """Yield some of the frames, not decoded."""
        if len(self.topics) == 1 and self._world is None:
            return self._read_single_topic(start, stop, step)
        return self._read_planned(range(len(self.stamps))[start:stop:step])

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
