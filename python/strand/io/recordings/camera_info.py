"""Read calibrations from sensor_msgs/CameraInfo, and name the topics that describe a depth topic."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from strand.support.checks import Array, check_intrinsics

_MODELS = ("plumb_bob", "rational_polynomial")  # lens models that strand knows
_COEFFICIENTS = (4, 5, 8)  # numbers of these


@dataclass(frozen=True, eq=False)
class Calibration:
    """A camera's pinhole matrix and image size.

    Attributes
    ----------
    matrix : (3, 3) ndarray
        [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
    size : (int, int) or None
        Height and width of the images, pixels; None if not known.
    distortion : (8,) ndarray or None
        The lens's k1, k2, p1, p2, k3, k4, k5, k6 as in OpenCV; None without distortion.
    """

    matrix: Array
    size: tuple[int, int] | None = None
    distortion: Array | None = None


def read_calibration(info: Any, *, rectified: bool, ignore_distortion: bool) -> Calibration:
    """Return the calibration in a CameraInfo: the left part of P for rectified images, else K.

    A lens with distortion raises ValueError. With `ignore_distortion`, K is used anyway, which is wrong by
    pixels near the image's edges.
    """
    k, d, p = (np.asarray(_get_field(info, name), dtype=np.float64) for name in "kdp")
    size = (int(info.height), int(info.width)) if info.height and info.width else None
    if rectified and p.size == 12 and p.any():
        return Calibration(check_intrinsics("CameraInfo.P", p.reshape(3, 4)[:, :3]), size)
    if d.any() and not ignore_distortion:
        raise ValueError(
            f"CameraInfo.D: expected no distortion, got {d.round(4).tolist()[:8]}; rectify the images first, "
            "or use them as they are with ignore_distortion=True (--ignore-distortion)"
        )
    if k.size != 9 or not k.any():
        raise ValueError("CameraInfo.K: expected a pinhole matrix, got zeros")
    return Calibration(check_intrinsics("CameraInfo.K", k.reshape(3, 3)), size)


def read_color_calibration(info: Any, *, rectified: bool) -> Calibration:
    """Return the calibration of a colour camera, whose lens may distort by the models of OpenCV."""
    plain = read_calibration(info, rectified=rectified, ignore_distortion=True)
    d = np.asarray(_get_field(info, "d"), dtype=np.float64)
    if rectified or not d.any():
        return plain
    if info.distortion_model not in _MODELS or len(d) not in _COEFFICIENTS or not np.isfinite(d).all():
        raise ValueError(
            f"CameraInfo.distortion_model: expected {' or '.join(_MODELS)}, got "
            f"{info.distortion_model[:40]!r} with {len(d)} numbers"
        )
    return Calibration(plain.matrix, plain.size, np.concatenate([d, np.zeros(8 - len(d))]))


def _get_field(info: Any, name: str) -> Any:
    """Return K, D or P, whose names ROS 2 writes in small letters."""
    return getattr(info, name) if hasattr(info, name) else getattr(info, name.upper())


def name_info_topic(topic: str) -> str:
    """Return the topic of an image's CameraInfo, by the rules of ROS or of RealSense files."""
    base = topic
    for transport in ("/compressedDepth", "/compressed"):
        base = base.removesuffix(transport)
    if base.endswith("/image/data"):
        return base.removesuffix("image/data") + "info/camera_info"
    return base.rpartition("/")[0] + "/camera_info"


def is_rectified(topic: str) -> bool:
    """Tell whether the topic's name says that images are rectified: image_rect, image_rect_raw."""
    return any(part.startswith("image_rect") for part in topic.split("/"))


def name_units_topic(topic: str) -> str:
    """Return the topic on which a RealSense file gives the metres per unit of depth."""
    sensor = topic.removesuffix("/image/data").rpartition("/")[0]
    return f"{sensor}/option/Depth Units/value"
