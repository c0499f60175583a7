"""Find the topics of a bag that show depth, with the calibration and unit of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from strand.io.recordings.bags import Bag
from strand.io.recordings.camera_info import (
    Calibration,
    is_rectified,
    name_info_topic,
    name_units_topic,
    read_calibration,
)
from strand.io.recordings.color_messages import is_color
from strand.io.recordings.depth_messages import is_depth
from strand.io.recordings.first_messages import CLOUDS, IMAGES, INFO, NUMBER
from strand.support.checks import Array
from strand.support.files import FileFormatError

_MAX_LISTED = 60  # topics that an error message names


@dataclass(frozen=True, eq=False)
class DepthTopic:
    """A topic that shows depth.

    Attributes
    ----------
    topic : str
    calibration : Calibration or None
        None if the topic has points.
    depth_scale : float or None
        Metres per unit of whole numbers; None for the encoding's own unit.
    """

    topic: str
    calibration: Calibration | None
    depth_scale: float | None


def choose_topics(bag: Bag, patterns: Sequence[str] | None) -> tuple[str, ...]:
    """Return the topics that match the patterns; without patterns, the only topic that shows depth.

    ValueError lists the topics if a pattern matches none, or if several show depth and there is no pattern.
    """
    shown = bag.find_topics(*IMAGES, *CLOUDS)
    if patterns is None:
        found = find_depth_topics(bag)
        if len(found) == 1:
            return found
        if not found:
            raise FileFormatError(bag.path, f"no topic shows depth; it has {list_topics(bag)}")
        raise ValueError(f"topics: several show depth, give one for each camera to use: {_join(found)}")
    topics: dict[str, None] = {}
    for pattern in patterns:
        matching = [
            topic
            for topic in shown
            if topic == pattern or (fnmatchcase(topic, pattern) and not shows_color(bag, topic))
        ]
        if not matching:
            kind = bag.topics.get(pattern)
            what = f"no depth: {pattern} is {kind}" if kind else f"no topic {pattern}"
            raise ValueError(f"topics: {what}; {bag.path} has {list_topics(bag)}")
        topics |= dict.fromkeys(matching)
    return tuple(topics)


def find_depth_topics(bag: Bag) -> tuple[str, ...]:
    """Return the topics with depth images; if there are none, the topics with points."""
    images = [topic for topic in bag.find_topics(*IMAGES) if _shows_depth(bag, topic)]
    return tuple(images or bag.find_topics(*CLOUDS))


def list_topics(bag: Bag) -> str:
    """Return topics and types as text for a message: those that may show depth, or else all."""
    topics = bag.find_topics(*IMAGES, *CLOUDS) or sorted(bag.topics)
    return _join([f"{topic} ({bag.topics[topic]})" for topic in topics]) or "no topics"


def _join(names: Sequence[str]) -> str:
    """Return the first names as text."""
    more = [f"{len(names) - _MAX_LISTED} more"] if len(names) > _MAX_LISTED else []
    return ", ".join([*names[:_MAX_LISTED], *more])


def read_depth_topic(
    bag: Bag, topic: str, intrinsics: Array | None, depth_scale: float | None, ignore_distortion: bool
) -> DepthTopic:
    """Return a topic with its unit and calibration; without `intrinsics`, the first CameraInfo gives them."""
    if bag.find_first(topic) is None:
        raise FileFormatError(bag.path, "the topic has no messages", topic)
    if bag.topics[topic] in CLOUDS:
        return DepthTopic(topic, None, None)
    if intrinsics is not None:
        calibration = Calibration(intrinsics)
    else:
        place = name_info_topic(topic)
        info = find_first(bag, place, INFO)
        if info is None:
            there = _join(bag.find_topics(INFO)) or "none"
            reason = f"no CameraInfo on {place} (the bag has it on: {there}); give intrinsics (--intrinsics)"
            raise FileFormatError(bag.path, reason, topic)
        try:
            calibration = read_calibration(
                info, rectified=is_rectified(topic), ignore_distortion=ignore_distortion
            )
        except (TypeError, ValueError) as error:
            raise FileFormatError(bag.path, str(error), place) from error
    if depth_scale is None:
        unit = find_first(bag, name_units_topic(topic), NUMBER)
        if unit is not None and unit.data > 0:
            depth_scale = round(float(unit.data), 9)  # removes the error of single precision
    return DepthTopic(topic, calibration, depth_scale)


def find_first(bag: Bag, topic: str, kind: str) -> Any:
    """Return the fields of the first message of a topic if it has this type, else None."""
    first = bag.find_first(topic) if bag.topics.get(topic) == kind else None
    return None if first is None else first.message


def shows_color(bag: Bag, topic: str) -> bool:
    """Tell whether the first message of a topic is a colour image."""
    first = bag.find_first(topic) if bag.topics.get(topic) in IMAGES else None
    return first is not None and is_color(first.message)


def _shows_depth(bag: Bag, topic: str) -> bool:
    first = bag.find_first(topic)
    if first is None:
        return False
    if topic.endswith("/image/data") and "/Depth_" in topic:  # RealSense files declare mono16
        return True
    return is_depth(first.message)
