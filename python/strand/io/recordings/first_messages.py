"""Keep what the first messages of cameras say, without their pixels, from one pass over a bag."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from strand.io.image_parts import read_size
from strand.io.recordings.camera_info import name_info_topic, name_units_topic
from strand.io.recordings.message import Message
from strand.support.files import FileFormatError

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CLOUDS = ("sensor_msgs/msg/PointCloud2",)
INFO = "sensor_msgs/msg/CameraInfo"
NUMBER = "std_msgs/msg/Float32"


@dataclass(frozen=True, eq=False)
class FirstMessage:
    """The first message of a topic.

    Attributes
    ----------
    time : int
        Time of recording, nanoseconds since 1970.
    message : object
        Its fields; `data` of images and points is empty.
    size : (int, int) or None
        Height and width that an image declares; None if it declares none.
    """

    time: int
    message: Any
    size: tuple[int, int] | None = None


FirstMessages = Mapping[str, "FirstMessage | FileFormatError"]


def read_first_messages(
    topics: Mapping[str, str],
    read_firsts: Callable[[Collection[str]], Iterator[Message]],
    decode: Callable[[Message], Any],
) -> FirstMessages:
    """Return the first message of each topic with images or points, and of the topics that describe these.

    Parameters
    ----------
    topics : mapping of str to str
        The type of each topic's messages.
    read_firsts, decode : callable
        Those of a bag. Instead of a message that cannot be decoded, its error is kept.
    """
    shown = [topic for topic, kind in topics.items() if kind in (*IMAGES, *CLOUDS)]
    beside = {name_info_topic(topic): INFO for topic in shown}
    beside |= {name_units_topic(topic): NUMBER for topic in shown}
    wanted = [*shown, *(topic for topic, kind in beside.items() if topics.get(topic) == kind)]
    found: dict[str, FirstMessage | FileFormatError] = {}
    for one in read_firsts(wanted):
        try:
            found[one.topic] = _strip(one, decode(one))
        except FileFormatError as error:
            found[one.topic] = error.with_traceback(None)
    return found


def _strip(one: Message, message: Any) -> FirstMessage:
    """Return a message without its pixels or points."""
    if one.kind not in (*IMAGES, *CLOUDS):
        return FirstMessage(one.time, message)
    size = None
    if hasattr(message, "format"):
        try:
            size = read_size(memoryview(message.data))
        except ValueError:  # the error comes where the image is needed
            size = None
    elif hasattr(message, "encoding"):
        size = int(message.height), int(message.width)
    message.data = np.empty(0, dtype=np.uint8)
    return FirstMessage(one.time, message, size)
