"""Pinholes from sensor_msgs/CameraInfo, and where a bag has them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from strand.support.checks import Array, check_intrinsics


@dataclass(frozen=True, eq=False)
class Pinhole:
    """How a camera sees.

    Attributes
    ----------
    matrix : (3, 3) ndarray
        [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
    size : (int, int) or None
        Height and width of its images, pixels; None if not known.
    """

    matrix: Array
    size: tuple[int, int] | None = None


def read_pinhole(info: Any, *, rectified: bool, ignore_distortion: bool) -> Pinhole:
    """Return P's left part for rectified images, else K.

    Parameters
    ----------
    info : sensor_msgs/CameraInfo
        Of ROS 1 or ROS 2.
    rectified : bool
        Whether the image is rectified.
    ignore_distortion : bool
        Take K though the lens distorts: off by pixels near the image's edges.

    Raises
    ------
    ValueError
        If it has no pinhole matrix, or the lens distorts.
    """
    k, d, p = (np.asarray(_field(info, name), dtype=np.float64) for name in "kdp")
    size = (int(info.height), int(info.width)) if info.height and info.width else None
    if rectified and p.size == 12 and p.any():
        return Pinhole(check_intrinsics("CameraInfo.P", p.reshape(3, 4)[:, :3]), size)
    if d.any() and not ignore_distortion:
        raise ValueError(
            f"CameraInfo.D: expected no distortion, got {d.round(4).tolist()[:8]}; rectify the images first, "
            "or ignore_distortion=True (--ignore-distortion) takes them as they are"
        )
    if k.size != 9 or not k.any():
        raise ValueError("CameraInfo.K: expected a pinhole matrix, got zeros")
    return Pinhole(check_intrinsics("CameraInfo.K", k.reshape(3, 3)), size)


def _field(info: Any, name: str) -> Any:
    """K, D or P: small letters in ROS 2."""
    return getattr(info, name) if hasattr(info, name) else getattr(info, name.upper())


def name_info_topic(topic: str) -> str:
    """Return the topic of an image's CameraInfo: beside it, or as RealSense's files have it."""
    base = topic
    for transport in ("/compressedDepth", "/compressed"):
        base = base.removesuffix(transport)
    if base.endswith("/image/data"):
        return base.removesuffix("image/data") + "info/camera_info"
    return base.rpartition("/")[0] + "/camera_info"


def is_rectified(topic: str) -> bool:
    """Whether an image's topic says that it is rectified: image_rect, image_rect_raw."""
    return any(part.startswith("image_rect") for part in topic.split("/"))


def name_units_topic(topic: str) -> str:
    """Return the topic where a file of RealSense's says how many metres a unit of its depth is."""
    sensor = topic.removesuffix("/image/data").rpartition("/")[0]
    return f"{sensor}/option/Depth Units/value"
