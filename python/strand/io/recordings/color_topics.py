"""Find the topic with the colours of each depth topic."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import takewhile

import numpy as np

from strand.io.recordings.bags import Bag
from strand.io.recordings.camera_info import is_rectified, name_info_topic, read_color_calibration
from strand.io.recordings.color_alignment import ColorCamera
from strand.io.recordings.color_messages import decode_color_message, is_color
from strand.io.recordings.topics import (
    CLOUDS,
    IMAGES,
    INFO,
    DepthTopic,
    decode_first,
    list_topics,
    shows_color,
)
from strand.support.checks import Array
from strand.support.files import FileFormatError

FindPose = Callable[[str, str, int], Array | None]  # the pose of a frame in another at a time


def find_color_cameras(
    bag: Bag, cameras: Sequence[DepthTopic], named: Sequence[str] | None, find_pose: FindPose, max_bytes: int
) -> tuple[dict[str, ColorCamera], dict[str, str]]:
    """Return the colour camera of each depth topic that has one, and why others have none.

    Parameters
    ----------
    bag : Bag
    cameras : sequence of DepthTopic
    named : sequence of str or None
        One colour topic for each, or none at all; None: the one whose name and place are nearest.
    find_pose : callable
        As `Transforms.find_pose`.
    max_bytes : int
        Memory limit of an image.

    Raises
    ------
    ValueError
        If a named topic does not exist, has no colours, or cannot be aligned.
    """
    found: dict[str, ColorCamera] = {}
    reasons: dict[str, str] = {}
    if named is not None:
        if len(named) not in (0, len(cameras)):
            raise ValueError(
                f"color_topics: expected one for each of {len(cameras)} topics, or none, got {len(named)}"
            )
        for camera, topic in zip(cameras, named, strict=False):
            try:
                found[camera.topic] = _read_color_camera(bag, camera, topic, find_pose, max_bytes)
            except FileFormatError:
                raise
            except ValueError as error:
                raise ValueError(f"color_topics: {bag.path}: {topic}: {error}") from error
        return found, reasons
    for camera in cameras:
        if bag.topics[camera.topic] in CLOUDS:
            continue
        for topic in _list_candidates(bag, camera.topic, alone=len(cameras) == 1):
            try:
                found[camera.topic] = _read_color_camera(bag, camera, topic, find_pose, max_bytes)
                reasons.pop(camera.topic, None)
                break
            except (ValueError, ImportError) as error:
                reasons.setdefault(camera.topic, f"{topic}: {error}")
    return found, reasons


def _list_candidates(bag: Bag, depth: str, alone: bool) -> list[str]:
    """Return the colour topics that may belong to a depth topic, the likeliest first.

    With several depth topics, those of one camera have the same first part of their names.
    """

    def count_shared(topic: str) -> int:
        pairs = zip(topic.strip("/").split("/"), depth.strip("/").split("/"), strict=False)
        return len(list(takewhile(lambda pair: pair[0] == pair[1], pairs)))

    topics = [topic for topic in bag.find_topics(*IMAGES) if topic != depth and shows_color(bag, topic)]
    near = [topic for topic in topics if alone or count_shared(topic)]
    raw = "sensor_msgs/msg/Image"
    return sorted(near, key=lambda topic: (-count_shared(topic), bag.topics[topic] != raw, topic))


def _read_color_camera(
    bag: Bag, camera: DepthTopic, topic: str, find_pose: FindPose, max_bytes: int
) -> ColorCamera:
    """Return the camera of a colour topic; ValueError says why its pixels cannot be aligned."""
    first = bag.read_first(topic) if topic in bag.topics else None
    if first is None:
        raise ValueError(f"no such topic with messages; the recording has {list_topics(bag)}")
    if bag.topics[topic] not in IMAGES:
        raise ValueError(f"expected colour images, got {bag.topics[topic]}")
    decoded = bag.decode(first)
    if not is_color(decoded):
        kind = getattr(decoded, "encoding", None) or decoded.format
        raise ValueError(f"expected colours, got {kind[:40]!r}")
    if camera.calibration is None:
        raise ValueError(f"{camera.topic} has points, which bring their own colours")
    frame, depth = decoded.header.frame_id, bag.read_first(camera.topic)
    assert depth is not None
    depth_frame = bag.decode(depth).header.frame_id
    info = decode_first(bag, name_info_topic(topic), INFO)
    calibration = None
    if info is not None:
        calibration = read_color_calibration(info, rectified=is_rectified(topic))
    # files of RealSense have the number of the image there
    if topic.endswith("/image/data") or frame.strip("/") != depth_frame.strip("/"):
        if calibration is None:
            raise ValueError(f"no CameraInfo on {name_info_topic(topic)}")
        if topic.endswith("/image/data"):
            raise ValueError("strand does not read where files of RealSense place the colour camera")
        find_pose(frame, depth_frame, first.time)
    size = decode_color_message(decoded, max_bytes).shape[:2]
    wanted = camera.calibration.size if calibration is None else calibration.size
    if wanted not in (None, size):
        what = "depth images" if calibration is None else "its CameraInfo"
        raise ValueError(f"images of {size[1]} x {size[0]} pixels, and {what} of {wanted[1]} x {wanted[0]}")
    return ColorCamera(topic, frame, calibration)


def find_color_pose(camera: ColorCamera, frame: str, stamp: int, find_pose: FindPose) -> Array | None:
    """Return the pose of a depth camera's frame in the colour camera's; the identity if they are one.

    None if TF has none at that time.
    """
    if camera.frame.strip("/") == frame.strip("/"):
        return np.eye(4)
    return find_pose(camera.frame, frame, stamp)
