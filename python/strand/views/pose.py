"""Poses of cameras: rigid motions from the camera frame to the world frame (eq. 1-9).

The equations are from *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from strand.support.checks import Array, check_number, check_rigid_motion, check_small_array


def rotation_xyz(rx: float, ry: float, rz: float) -> Array:
    """Return the rotation matrix R_x R_y R_z of three angles (eq. 4-9).

    Parameters
    ----------
    rx, ry, rz : float
        Angles about the x, y and z axes, radians.

    Returns
    -------
    (3, 3) ndarray
        Its columns are the unit vectors e_x, e_y, e_z of the turned frame.

    Raises
    ------
    TypeError
        If an angle is not a number.
    ValueError
        If an angle is not finite.
    """
    angles = np.array(
        [check_number(f"angles, {name}", angle) for name, angle in (("rx", rx), ("ry", ry), ("rz", rz))]
    )
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z)


def pose_from_angles(rx: float, ry: float, rz: float, origin: ArrayLike) -> Array:
    """Return the camera-to-world pose of three angles and the camera's position (eq. 1-9).

    w = w_0 + [e_x e_y e_z] c with e_* = R_x R_y R_z applied to the unit axes.

    Parameters
    ----------
    rx, ry, rz : float
        Angles about the x, y and z axes, radians.
    origin : (3,) array_like
        w_0, the camera's centre in the world frame, metres.

    Returns
    -------
    (4, 4) ndarray

    Raises
    ------
    TypeError
        If an angle is not a number, or `origin` does not hold real numbers.
    ValueError
        If a number is not finite or `origin` is not of shape (3,).

    Examples
    --------
    >>> import numpy as np
    >>> import strand
    >>> pose = strand.pose_from_angles(np.pi, 0.0, 0.0, [0.0, 0.0, 0.5])  # half a metre up, looking down
    >>> pose[2].round(6).tolist()
    [0.0, 0.0, -1.0, 0.5]
    """
    pose = np.eye(4)
    pose[:3, :3] = rotation_xyz(rx, ry, rz)
    pose[:3, 3] = check_small_array("origin", origin, (3,))
    return pose


def turntable_pose(
    camera: ArrayLike,
    angle: float,
    center: ArrayLike = (0.0, 0.0, 0.0),
    axis: ArrayLike = (0.0, 0.0, 1.0),
) -> Array:
    """Return the camera-to-plate pose when a plate turns under a fixed camera.

    The world frame turns with the plate. So turning the plate by `angle` moves the camera by `-angle` about
    the same axis.

    Parameters
    ----------
    camera : (4, 4) array_like
        Camera-to-world pose with the plate at angle 0.
    angle : float
        The plate's angle, radians, right-handed about `axis`.
    center : (3,) array_like
        A point of the turning axis, metres, world frame.
    axis : (3,) array_like
        The direction of the axis, world frame, of any length.

    Returns
    -------
    (4, 4) ndarray

    Raises
    ------
    TypeError
        If an array does not hold real numbers.
    ValueError
        If `camera` is not a rigid motion, `axis` has no length or one above 1e150, or a number is not
        finite.
    """
    camera = check_rigid_motion("camera", camera)
    center, axis = check_small_array("center", center, (3,)), check_small_array("axis", axis, (3,))
    if not 1e-150 < np.abs(axis).max() < 1e150:  # else its length is 0 or infinite
        raise ValueError(f"axis: expected a direction, got {axis}")
    length = float(np.linalg.norm(axis))
    turn = np.eye(4)
    turn[:3, :3] = make_rotation(axis / length, -check_number("angle", angle))
    turn[:3, 3] = center - turn[:3, :3] @ center
    return np.asarray(turn @ camera)


def make_rotation(axis: Array, angle: float) -> Array:
    """(3, 3) Return the right-handed rotation about a (3,) unit axis, radians, by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross))


def to_rotation_vector(rotation: Array) -> Array:
    """(3,) Return the unit axis of a (3, 3) rotation times its angle, radians."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation.tolist()
    axis = np.array([zy - yz, xz - zx, yx - xy])
    sine = 0.5 * math.hypot(*axis)
    angle = math.atan2(sine, 0.5 * (xx + yy + zz - 1.0))
    # the differences do not give the axis of a half turn; corrections are smaller
    return 0.5 * axis * (angle / sine if sine > 0.0 else 1.0)


def measure_motions(motions: Array, center: Array) -> Array:
    """(K, 6) Return rotation vectors, radians, and shifts of a point, metres, by (K, 4, 4) rigid motions."""
    shifts = motions[:, :3, :3] @ center + motions[:, :3, 3] - center
    turns = np.array([to_rotation_vector(motion[:3, :3]) for motion in motions]).reshape(-1, 3)
    return np.hstack([turns, shifts])


def moved_by_each(points: Array, motions: Array) -> Array:
    """(K, M, 3) Return (M, 3) or (K, M, 3) points after each of (K, 4, 4) rigid motions."""
    return np.asarray(points @ motions[:, :3, :3].transpose(0, 2, 1) + motions[:, None, :3, 3])


def moved(points: Array, motion: Array) -> Array:
    """Return (..., 3) points after a (4, 4) rigid motion."""
    turned = np.asarray(points @ motion[:3, :3].T)
    turned += motion[:3, 3]
    return turned
