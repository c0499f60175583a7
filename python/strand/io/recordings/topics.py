"""Which topics of a bag show depth, and what is known of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from strand.io.recordings.bags import Bag
from strand.io.recordings.camera_info import (
    Pinhole,
    is_rectified,
    name_info_topic,
    name_units_topic,
    read_pinhole,
)
from strand.io.recordings.depth_messages import is_depth
from strand.support.checks import Array
from strand.support.files import FileFormatError

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CLOUDS = ("sensor_msgs/msg/PointCloud2",)
INFO = "sensor_msgs/msg/CameraInfo"
NUMBER = "std_msgs/msg/Float32"
_SHOWN = 60  # topics that a message names


@dataclass(frozen=True, eq=False)
class Camera:
    """A topic that shows depth.

    Attributes
    ----------
    topic : str
    pinhole : Pinhole or None
        How it sees; None if the topic has points.
    depth_scale : float or None
        Metres for each unit of whole numbers; None: as the encoding says.
    """

    topic: str
    pinhole: Pinhole | None
    depth_scale: float | None


def choose_topics(bag: Bag, patterns: Sequence[str] | None) -> tuple[str, ...]:
    """Return the topics that were asked for, or else the one that shows depth.

    Raises
    ------
    ValueError
        If there is no such topic, or none was asked for and several show depth; the message lists them.
    strand.FileFormatError
        If the bag has no depth.
    """
    shown = bag.find_topics(*IMAGES, *CLOUDS)
    if patterns is None:
        found = find_depth_topics(bag)
        if len(found) == 1:
            return found
        if not found:
            raise FileFormatError(bag.path, f"no topic shows depth; it has {list_topics(bag)}")
        raise ValueError(
            f"topics: several show depth, say which one, or which are of several cameras: {', '.join(found)}"
        )
    topics: list[str] = []
    for pattern in patterns:
        matching = [topic for topic in shown if topic == pattern or fnmatchcase(topic, pattern)]
        if not matching:
            kind = bag.topics.get(pattern)
            what = f"no depth: {pattern} is {kind}" if kind else f"no topic {pattern}"
            raise ValueError(f"topics: {what}; {bag.path} has {list_topics(bag)}")
        topics += [topic for topic in matching if topic not in topics]
    return tuple(topics)


def find_depth_topics(bag: Bag) -> tuple[str, ...]:
    """Return the images that show depth; points if there are none."""
    images = [topic for topic in bag.find_topics(*IMAGES) if _shows_depth(bag, topic)]
    return tuple(images or bag.find_topics(*CLOUDS))


def list_topics(bag: Bag) -> str:
    """Topics with their types, as messages name them: those that may show depth, if there are any."""
    topics = bag.find_topics(*IMAGES, *CLOUDS) or sorted(bag.topics)
    named = [f"{topic} ({bag.topics[topic]})" for topic in topics[:_SHOWN]]
    more = [f"{len(topics) - _SHOWN} more"] if len(topics) > _SHOWN else []
    return ", ".join(named + more) or "no topics"


def read_camera(
    bag: Bag, topic: str, intrinsics: Array | None, depth_scale: float | None, ignore_distortion: bool
) -> Camera:
    """Return what is known of a topic: its CameraInfo's first message says how it sees.

    Raises
    ------
    strand.FileFormatError
        If an image's CameraInfo is missing, or no pinhole.
    """
    if bag.read_first(topic) is None:
        raise FileFormatError(bag.path, "the topic has no messages", topic)
    if bag.topics[topic] in CLOUDS:
        return Camera(topic, None, None)
    if intrinsics is not None:
        pinhole = Pinhole(intrinsics)
    else:
        place = name_info_topic(topic)
        info = _first(bag, place, INFO)
        if info is None:
            there = ", ".join(bag.find_topics(INFO)) or "none"
            reason = f"no CameraInfo on {place}, but on: {there}; intrinsics= says what the camera is"
            raise FileFormatError(bag.path, reason, topic)
        try:
            pinhole = read_pinhole(info, rectified=is_rectified(topic), ignore_distortion=ignore_distortion)
        except (TypeError, ValueError) as error:
            raise FileFormatError(bag.path, str(error), place) from error
    if depth_scale is None:
        unit = _first(bag, name_units_topic(topic), NUMBER)
        if unit is not None and unit.data > 0:
            depth_scale = round(float(unit.data), 9)  # from single precision
    return Camera(topic, pinhole, depth_scale)


def _first(bag: Bag, topic: str, kind: str) -> Any:
    """Return the first message of a topic of a type, decoded; None if there is none."""
    if bag.topics.get(topic) != kind:
        return None
    message = bag.read_first(topic)
    return None if message is None else bag.decode(message)


def _shows_depth(bag: Bag, topic: str) -> bool:
    message = bag.read_first(topic)
    if message is None:
        return False
    if topic.endswith("/image/data") and "/Depth_" in topic:  # RealSense's files say mono16
        return True
    return is_depth(bag.decode(message))
