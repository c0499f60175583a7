"""Bags of a moving rope with the topics of the node of `ros/`, and their messages read back by rosbags."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import Reader

from lib.bag_files import START, Entry, Messages
from lib.ros_messages import STORE
from strand.synthetic.sequences import SequenceFrame

SECOND = 10**9  # nanoseconds


def record_sequence(
    frames: Iterable[SequenceFrame], *, masks: bool = True, meters: bool = False, start: int = START
) -> Iterator[Entry]:
    """Yield TF, CameraInfo, mask or colours, and depth of each frame, at the times of the frames.

    Depth is 16UC1 in millimetres, or with `meters` 32FC1 with NaN where there is none.
    """
    made = Messages()
    for frame in frames:
        time = start + round(frame.time * SECOND)
        yield "/tf", time, made.tf([("world", "camera", frame.poses[0])], time)
        yield "depth/camera_info", time, made.info(frame.intrinsics, frame.depth[0].shape, time)
        if masks:
            mask = np.where(frame.mask[0], np.uint8(255), np.uint8(0))
            yield "mask/image", time, made.image(mask, time, encoding="mono8")
        if frame.color is not None:
            yield "color/image", time, made.color(frame.color[0], time)
        depth = frame.depth[0] * frame.depth_scale
        if meters:
            sent = np.where(depth > 0, depth, np.nan).astype(np.float32)
        else:
            sent = np.round(1e3 * depth).astype(np.uint16)
        yield "depth/image", time, made.image(sent, time)


def read_bag(path: Path) -> Iterator[Entry]:
    """Yield the topics, times and messages of a ROS 2 bag."""
    with Reader(path) as reader:
        for connection, time, data in reader.messages():
            yield connection.topic, time, STORE.deserialize_cdr(data, connection.msgtype)
