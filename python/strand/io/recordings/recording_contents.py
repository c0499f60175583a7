"""What a recording holds, from its index and the first messages of each camera and of TF."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from strand.io.recordings.bags import Bag
from strand.io.recordings.message_views import make_view
from strand.io.recordings.topics import choose_topics, find_depth_topics, read_camera
from strand.io.recordings.transforms import TF_KINDS, Transforms
from strand.io.view_summary import ViewSummary, summarize_view
from strand.support.files import FileFormatError

# cameras that are looked at, and messages of each topic of TF
_CAMERAS, _TRANSFORMS = 32, 100


@dataclass(frozen=True)
class Topic:
    """A topic of a recording.

    Attributes
    ----------
    topic : str
    kind : str
        The type of its messages.
    messages : int
    rate : float or None
        Messages a second; None if there are fewer than two.
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
    frame : str or None
        The TF frame of its first message; None without a message.
    size : (int, int) or None
        Width and height of its images, pixels; None if they are not known before decompression, or of points.
    view : Seen or None
        What its first message shows; None if strand cannot read it.
    trouble : str or None
        Why not.
    """

    topic: str
    messages: int
    frame: str | None
    size: tuple[int, int] | None
    view: ViewSummary | None
    trouble: str | None


@dataclass(frozen=True, eq=False)
class RecordingContents:
    """What a recording holds.

    Attributes
    ----------
    format : str
        "ROS 1 bag", "ROS 2 bag", "MCAP file" or "SQLite file of a ROS 2 bag".
    start : int or None
        When the first message was recorded, nanoseconds since 1970; None without a message.
    seconds : float
        From the first message to the last one.
    topics : tuple of Topic
        In alphabetical order.
    cameras : tuple of CameraContents
        The topics that show depth: those that were asked for, or else all.
    tf_frames : tuple of str
        The frames that the first messages of TF name.
    tf_trouble : str or None
        What is wrong with these messages.
    """

    format: str
    start: int | None
    seconds: float
    topics: tuple[Topic, ...]
    cameras: tuple[CameraContents, ...]
    tf_frames: tuple[str, ...]
    tf_trouble: str | None


def read_recording_contents(path: Path, patterns: Sequence[str] | None, max_bytes: int) -> RecordingContents:
    """Return what a recording holds; arguments and errors are those of `strand.Recording`."""
    bag = Bag(path, max_bytes)
    try:
        topics = find_depth_topics(bag) if patterns is None else choose_topics(bag, patterns)
        frames, trouble = _tf_frames(bag, max_bytes)
        start, seconds = bag.span
        return RecordingContents(
            bag.format,
            start,
            seconds,
            tuple(
                Topic(topic, kind, bag.counts[topic], _rate(bag.counts[topic], seconds))
                for topic, kind in sorted(bag.topics.items())
            ),
            tuple(_camera(bag, topic, max_bytes) for topic in topics[:_CAMERAS]),
            frames,
            trouble,
        )
    finally:
        bag.close()


def _rate(count: int, seconds: float) -> float | None:
    return (count - 1) / seconds if count > 1 and seconds > 0.0 else None


def _camera(bag: Bag, topic: str, max_bytes: int) -> CameraContents:
    message = bag.read_first(topic)
    if message is None:
        return CameraContents(topic, 0, None, None, None, "the topic has no messages")
    decoded = bag.decode(message)
    frame, size, count = decoded.header.frame_id, _size(decoded), bag.counts[topic]
    try:
        camera = read_camera(bag, topic, None, None, False)
        view = make_view(decoded, camera.pinhole, None, camera.depth_scale, max_bytes)
    except FileFormatError as error:
        return CameraContents(topic, count, frame, size, None, error.reason)
    except (TypeError, ValueError) as error:
        return CameraContents(topic, count, frame, size, None, str(error))
    return CameraContents(topic, count, frame, size, summarize_view(view), None)


def _size(message: Any) -> tuple[int, int] | None:
    """Width and height that an Image says it has; None of points and of compressed images."""
    return (int(message.width), int(message.height)) if hasattr(message, "encoding") else None


def _tf_frames(bag: Bag, max_bytes: int) -> tuple[tuple[str, ...], str | None]:
    """Return the frames that TF names at first, and what is wrong with it."""
    found = Transforms(0, max_bytes)
    for topic in bag.find_topics(*TF_KINDS):
        for message in islice(bag.read_messages([topic]), _TRANSFORMS):
            try:
                found.add(bag.decode(message), static=topic.endswith("tf_static"))
            except ValueError as error:
                return tuple(found.frames), str(error)
    return tuple(found.frames), None
