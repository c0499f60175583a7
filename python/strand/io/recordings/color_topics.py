"""Find the topic with the colours of each depth topic."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence

import numpy as np

from strand.io.recordings.bags import Bag
from strand.io.recordings.camera_info import is_rectified, name_info_topic, read_color_calibration
from strand.io.recordings.color_alignment import ColorCamera
from strand.io.recordings.color_messages import is_color
from strand.io.recordings.first_messages import CLOUDS, IMAGES, INFO
from strand.io.recordings.topics import DepthTopic, find_first, list_topics, shows_color
from strand.support.checks import Array
from strand.support.extras import import_extra
from strand.support.files import FileFormatError

_MAX_CANDIDATES = 64  # colour topics that are tried for a depth topic
_MAX_SHARED = 8  # parts of the names of topics that are compared
FindPose = Callable[[str, str, int], Array | None]  # the pose of a frame in another at a time


def find_color_cameras(
    bag: Bag, cameras: Sequence[DepthTopic], named: Sequence[str] | None, find_pose: FindPose
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
                found[camera.topic] = _read_color_camera(bag, camera, topic, find_pose)
            except FileFormatError:
                raise
            except ValueError as error:
                raise ValueError(f"color_topics: {bag.path}: {topic}: {error}") from error
        return found, reasons
    candidates = _Candidates(bag)
    for camera in cameras:
        if bag.topics[camera.topic] in CLOUDS:
            continue
        for topic in candidates.list_near(camera.topic, alone=len(cameras) == 1):
            try:
                found[camera.topic] = _read_color_camera(bag, camera, topic, find_pose)
                reasons.pop(camera.topic, None)
                break
            except (ValueError, ImportError) as error:
                reasons.setdefault(camera.topic, f"{topic}: {error}")
    return found, reasons


class _Candidates:
    """The colour topics of a bag by the first parts of their names, the likeliest first."""

    def __init__(self, bag: Bag) -> None:
        raw = "sensor_msgs/msg/Image"
        topics = [topic for topic in bag.find_topics(*IMAGES) if shows_color(bag, topic)]
        self._below: dict[str, list[str]] = defaultdict(list)
        for topic in sorted(topics, key=lambda topic: (bag.topics[topic] != raw, topic)):
            for first in _list_beginnings(topic):
                if len(self._below[first]) < _MAX_CANDIDATES:
                    self._below[first].append(topic)

    def list_near(self, depth: str, alone: bool) -> list[str]:
        """Return the colour topics that may belong to a depth topic, the likeliest first.

        With several depth topics, those of one camera have the same first part of their names.
        """
        near: dict[str, None] = {}
        for first in reversed(_list_beginnings(depth)):
            if first or alone:
                near |= dict.fromkeys(topic for topic in self._below.get(first, ()) if topic != depth)
        return list(near)[:_MAX_CANDIDATES]


def _list_beginnings(topic: str) -> list[str]:
    """Return the first parts of a topic's name, from none of them on."""
    parts = topic.strip("/").split("/")[:_MAX_SHARED]
    return ["/".join(parts[:count]) for count in range(len(parts) + 1)]


def _read_color_camera(bag: Bag, camera: DepthTopic, topic: str, find_pose: FindPose) -> ColorCamera:
    """Return the camera of a colour topic; ValueError says why its pixels cannot be aligned."""
    if not bag.counts.get(topic):
        raise ValueError(f"no such topic with messages; the recording has {list_topics(bag)}")
    if bag.topics[topic] not in IMAGES:
        raise ValueError(f"expected colour images, got {bag.topics[topic]}")
    first, depth = bag.find_first(topic), bag.find_first(camera.topic)
    if first is None or depth is None:
        raise ValueError("the index counts messages, but there are none")
    if not is_color(first.message):
        kind = getattr(first.message, "encoding", None) or first.message.format
        raise ValueError(f"expected colours, got {kind[:40]!r}")
    if camera.calibration is None:
        raise ValueError(f"{camera.topic} has points, which bring their own colours")
    if hasattr(first.message, "format"):
        import_extra("PIL.Image")
    frame, depth_frame = first.message.header.frame_id, depth.message.header.frame_id
    info = find_first(bag, name_info_topic(topic), INFO)
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
    size = first.size
    if size is None:
        raise ValueError("the first image is truncated, or not a PNG or JPEG")
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
