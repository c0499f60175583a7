"""The camera of a scene: its image, the device it imitates, and the poses around the ropes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array, check_number, check_positive
from strand.synthetic.depth_camera import CAMERAS, DepthCamera
from strand.synthetic.rendering import check_size

FOCAL_LENGTH = 212.0 / 320.0
"""Focal length of a scene's cameras, in image widths."""

TABLE_ELEVATION = math.radians(50.0)
"""Default angle of a camera above the table, radians."""

_AROUND_TABLE = math.radians(90.0)  # radians: largest azimuth of a camera at a table
_BEFORE_WALL = math.radians(40.0)  # radians: largest azimuth of a camera before a wall
_BORDER = 0.02  # fraction of the image's width and height that stays free of ropes


@dataclass(frozen=True)
class Camera:
    """The image that a scene's camera takes, and the depth camera that it imitates.

    Attributes
    ----------
    device : str or DepthCamera, optional
        A key of `CAMERAS`, or a depth camera of your own. Its errors are wide and correlated, and the
        scene has a mask. Without a device, errors are normal and independent.
    size : (int, int)
        Width and height of an image, pixels. The focal length grows with the width.
    depth_scale : float
        Metres per unit of depth.

    Raises
    ------
    TypeError
        If `device` is neither a name nor a `DepthCamera`, or a number has the wrong type.
    ValueError
        If `CAMERAS` has no such device, or a number is not positive.
    """

    device: str | DepthCamera | None = None
    size: tuple[int, int] = (320, 240)
    depth_scale: float = 1e-4

    def __post_init__(self) -> None:
        if self.device is not None:
            find_device(self.device)
        object.__setattr__(self, "size", check_size(self.size))
        object.__setattr__(self, "depth_scale", check_positive("depth_scale", self.depth_scale))

    @property
    def focal_length(self) -> float:
        """Focal length, pixels."""
        return FOCAL_LENGTH * self.size[0]

    @property
    def intrinsics(self) -> Array:
        """The (3, 3) pinhole matrix, pixels."""
        (width, height), focal_length = self.size, self.focal_length
        return np.array(
            [
                [focal_length, 0.0, 0.5 * (width - 1)],
                [0.0, focal_length, 0.5 * (height - 1)],
                [0.0, 0.0, 1.0],
            ]
        )


def find_device(device: str | DepthCamera) -> DepthCamera:
    """Return the depth camera with this name, or the given one."""
    if isinstance(device, DepthCamera):
        return device
    if not isinstance(device, str):
        raise TypeError(f"device: expected a name or a DepthCamera, got {type(device).__name__}")
    if device not in CAMERAS:
        raise ValueError(f"device: expected one of {', '.join(CAMERAS)}, got {device!r}")
    return CAMERAS[device]


def camera_pose(azimuth: float, distance: float, elevation: float = TABLE_ELEVATION) -> Array:
    """Return the pose of an upright camera that looks at the origin, camera to world.

    Parameters
    ----------
    azimuth : float
        Angle about the world's z axis from the x axis to the camera, radians.
    distance : float
        Distance from the origin to the camera's centre, metres.
    elevation : float
        Angle of the camera above the table z = 0, radians; 50 degrees by default.

    Returns
    -------
    (4, 4) ndarray

    Raises
    ------
    TypeError
        If an argument is not a number.
    ValueError
        If an angle is not finite, or `distance` is not positive.

    Examples
    --------
    >>> import math
    >>> import strand
    >>> pose = strand.synthetic.camera_pose(azimuth=0.0, distance=0.5, elevation=0.5 * math.pi)
    >>> float(pose[2, 3])  # the camera's height above the table, metres
    0.5
    """
    azimuth, elevation = check_number("azimuth", azimuth), check_number("elevation", elevation)
    outward = np.array(
        [
            math.cos(elevation) * math.cos(azimuth),
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
        ]
    )
    right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(right, outward), -outward], axis=1)
    pose[:3, 3] = check_positive("distance", distance) * outward
    return pose


def spread_azimuths(views: int, before_wall: bool = False) -> Array:
    """Return the (V,) azimuths of a scene's cameras, radians, evenly spread; 0 for a single camera."""
    outermost = _BEFORE_WALL if before_wall else _AROUND_TABLE
    return np.linspace(-outermost, outermost, views) if views > 1 else np.zeros(1)


def find_least_distance(
    nodes: Array, radius: float, azimuths: Array, elevation: float, size: tuple[int, int]
) -> float:
    """Return the least distance from the origin at which every camera sees all of the ropes, metres.

    `nodes` and `radius` are in metres, `azimuths` and `elevation` in radians, `size` in pixels.
    """
    half_view = (0.5 - _BORDER) * np.array(size) / (FOCAL_LENGTH * size[0])
    # the nodes in each camera's frame; the distance would only be added to z
    rotated = [nodes @ camera_pose(azimuth, 1.0, elevation)[:3, :3] for azimuth in azimuths]
    return max(float(((np.abs(v[:, :2]) + radius) / half_view - v[:, 2:]).max()) for v in rotated)
