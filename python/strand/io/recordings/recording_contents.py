"""Find out what a recording contains, from its index and the first messages of cameras and TF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from strand.io.recordings.bags import Bag
from strand.io.recordings.message import Message
from strand.io.recordings.message_views import make_view
from strand.io.recordings.topics import choose_topics, find_depth_topics, read_depth_topic
from strand.io.recordings.transforms import TF_KINDS, Transforms
from strand.io.view_summary import ViewSummary, summarize_view
from strand.support.files import FileFormatError

_MAX_CAMERAS = 32  # cameras whose first message is decoded
_MAX_TRANSFORMS = 100  # messages that are decoded from each topic of TF


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    topic : str
    kind : str
        The type of the messages.
    messages : int
        Number of messages.
    rate : float or None
        Messages per second; None for fewer than two.
    """

    topic: str
    kind: str
    messages: int
    rate: float | None


@dataclass(frozen=True, eq=False)
class CameraContents:
    """A topic that shows depth.

    Attributes
    ----------
    topic : str
    messages : int
        Number of messages.
    frame : str or None
        The TF frame of the first message; None without a message.
    size : (int, int) or None
        Width and height of the images, pixels; None for points and compressed images.
    view : ViewSummary or None
        The content of the first message; None if strand cannot read it.
    trouble : str or None
        Why strand cannot read it.
    """

    topic: str
    messages: int
    frame: str | None
    size: tuple[int, int] | None
    view: ViewSummary | None
    trouble: str | None


@dataclass(frozen=True, eq=False)
class RecordingContents:
    """The content of a recording.

    Attributes
    ----------
    format : str
        "ROS 1 bag", "ROS 2 bag", "MCAP file", "SQLite file of a ROS 2 bag" or "LeRobot data set v3.0".
    start : int or None
        Time of the first message, nanoseconds since 1970; None without a message.
    seconds : float
        Time from the first message to the last.
    topics : tuple of Topic
        In alphabetical order.
    cameras : tuple of CameraContents
        The topics that show depth, all or those that the caller asked for.
    tf_frames : tuple of str
        The frames in the first messages of TF.
    tf_trouble : str or None
        The error in these messages.
    episodes : int or None
        The number of episodes; None if the recording is no LeRobot data set.
    """

    format: str
    start: int | None
    seconds: float
    topics: tuple[Topic, ...]
    cameras: tuple[CameraContents, ...]
    tf_frames: tuple[str, ...]
    tf_trouble: str | None
    episodes: int | None = None


def read_recording_contents(path: Path, patterns: Sequence[str] | None, max_bytes: int) -> RecordingContents:
    """Return the content of a recording; `patterns` select topics as in `strand.Recording`."""
    bag = Bag(path, max_bytes)
    try:
        topics = find_depth_topics(bag) if patterns is None else choose_topics(bag, patterns)
        frames, trouble = _read_tf_frames(bag)
        start, seconds = bag.span
        return RecordingContents(
            bag.format,
            start,
            seconds,
            tuple(
                Topic(topic, kind, bag.counts[topic], _compute_rate(bag.counts[topic], seconds))
                for topic, kind in sorted(bag.topics.items())
            ),
            _read_cameras(bag, topics[:_MAX_CAMERAS]),
            frames,
            trouble,
        )
    finally:
        bag.close()


def _compute_rate(count: int, seconds: float) -> float | None:
    return (count - 1) / seconds if count > 1 and seconds > 0.0 else None


def _read_cameras(bag: Bag, topics: Sequence[str]) -> tuple[CameraContents, ...]:
    """Return cameras by the first message of each topic, in one pass over the bag."""
    none = "the topic has no messages"
    found = {topic: CameraContents(topic, 0, None, None, None, none) for topic in topics}
    for message in bag.read_firsts(topics):
        found[message.topic] = _read_camera(bag, message)
    return tuple(found.values())


def _read_camera(bag: Bag, message: Message) -> CameraContents:
    topic, decoded = message.topic, bag.decode(message)
    frame, size, count = decoded.header.frame_id, _get_size(decoded), bag.counts[topic]
    budget = bag.budget.copy()
    try:
        budget.take(bag.path, message.size)
        camera = read_depth_topic(bag, topic, None, None, False)
        view = make_view(decoded, camera.calibration, None, camera.depth_scale, budget)
    except FileFormatError as error:
        return CameraContents(topic, count, frame, size, None, error.reason)
    except (TypeError, ValueError) as error:
        return CameraContents(topic, count, frame, size, None, str(error))
    return CameraContents(topic, count, frame, size, summarize_view(view), None)


def _get_size(message: Any) -> tuple[int, int] | None:
    """Return the width and height that an Image declares; None for points and compressed images."""
    return (int(message.width), int(message.height)) if hasattr(message, "encoding") else None


def _read_tf_frames(bag: Bag) -> tuple[tuple[str, ...], str | None]:
    """Return the frames in the first messages of TF, and the error in them or None."""
    found = Transforms(0, bag.budget.left)
    left = {topic: min(bag.counts[topic], _MAX_TRANSFORMS) for topic in bag.find_topics(*TF_KINDS)}
    most = sum(left.values())
    for message in bag.read_messages(list(left)) if most else ():
        if left[message.topic]:
            left[message.topic] -= 1
            most -= 1
            try:
                found.add(bag.decode(message), static=message.topic.endswith("tf_static"))
            except ValueError as error:
                return tuple(found.frames), str(error)
        if not most:
            break
    return tuple(found.frames), None
