"""Cameras, poses and views: from depth images to points in the world frame (eq. 1-9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand import _core
from strand.arguments import as_array, number, several, whole

Array = NDArray[np.float64]


def float_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return `value` as a C-ordered float64 array of the given shape.

    Parameters
    ----------
    name : str
        The argument's name, for the error message.
    value : array_like
        Anything NumPy reads as an array of floats.
    shape : tuple of int or None
        The accepted shape; None stands for any length.

    Raises
    ------
    TypeError
        If the elements are not floating point numbers.
    ValueError
        If the shape differs.
    """
    array = as_array(name, value)
    if array.dtype.kind != "f":
        raise TypeError(f"{name}: expected floating point numbers, got dtype {array.dtype}")
    if array.ndim != len(shape) or any(
        want is not None and want != got for want, got in zip(shape, array.shape, strict=True)
    ):
        want = "(" + ", ".join("N" if n is None else str(n) for n in shape) + ")"
        raise ValueError(f"{name}: expected shape {want}, got {array.shape}")
    return np.ascontiguousarray(array, dtype=np.float64)


def finite_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return `value` as `float_array` does, and refuse NaN and infinities.

    Raises
    ------
    TypeError
        If the elements are not floating point numbers.
    ValueError
        If the shape differs or an element is not finite.
    """
    array = float_array(name, value, shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers, got NaN or infinity")
    return array


def color_array(name: str, value: ArrayLike, shape: tuple[int | None, ...]) -> Array:
    """Return colours as a float64 array of the given shape, from 0 to 1.

    Raises
    ------
    TypeError
        If the elements are neither floating point numbers nor uint8.
    ValueError
        If the shape differs, or a number is not from 0 to 1 (uint8: from 0 to 255).
    """
    array = np.asarray(value)
    colors = finite_array(name, array / 255.0 if array.dtype == np.uint8 else array, shape)
    if colors.size and not (colors.min() >= 0 and colors.max() <= 1):
        raise ValueError(
            f"{name}: expected colours from 0 to 1, or uint8, got {colors.min()} to {colors.max()}"
        )
    return colors


def rigid_motion(name: str, value: ArrayLike) -> Array:
    """Return `value` as a (4, 4) rigid motion.

    Raises
    ------
    TypeError
        If the elements are not floating point numbers.
    ValueError
        If the matrix is not a rotation and a translation: wrong shape or last row, not finite, a
        rotation that scales, shears or mirrors by more than 1e-6.
    """
    pose = finite_array(name, value, (4, 4))
    rotation = pose[:3, :3]
    if np.abs(pose[3] - (0, 0, 0, 1)).max() > 1e-9:
        raise ValueError(f"{name}: expected the last row (0, 0, 0, 1), got {pose[3]}")
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-6 or np.linalg.det(rotation) < 0:
        raise ValueError(f"{name}: expected a rigid motion, but its (3, 3) part is not a rotation")
    return pose


def extraction_range(value: tuple[ArrayLike, ArrayLike]) -> tuple[Array, Array]:
    """Return `bounds` as the low and the high corner of an axis-aligned box in the world frame, metres.

    Infinities leave a side open.

    Raises
    ------
    TypeError
        If the corners are not numbers.
    ValueError
        If there are not two corners of three numbers, or a low one is not below its high one.
    """
    try:
        low, high = value
    except (TypeError, ValueError):
        raise ValueError("bounds: expected a pair (low, high) of corners") from None
    low, high = (
        corner.astype(np.float64) if corner.dtype.kind in "iu" else corner
        for corner in (as_array("bounds", low), as_array("bounds", high))
    )
    low, high = float_array("bounds[0]", low, (3,)), float_array("bounds[1]", high, (3,))
    if not (low < high).all():
        raise ValueError(f"bounds: expected low < high in x, y and z, got {low} and {high}")
    return low, high


def rotation_xyz(rx: float, ry: float, rz: float) -> Array:
    """Rotation matrix R_x R_y R_z of three angles (eq. 4-9).

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
        [number(f"angles, {name}", angle) for name, angle in (("rx", rx), ("ry", ry), ("rz", rz))]
    )
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z)


def pose_from_angles(rx: float, ry: float, rz: float, origin: ArrayLike) -> Array:
    """Camera-to-world pose from three angles and the camera's position (eq. 1-9).

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
        If an angle is not a number, or `origin` does not hold floating point numbers.
    ValueError
        If a number is not finite or `origin` is not of shape (3,).
    """
    pose = np.eye(4)
    pose[:3, :3] = rotation_xyz(rx, ry, rz)
    pose[:3, 3] = finite_array("origin", origin, (3,))
    return pose


def turntable_pose(
    camera: ArrayLike,
    angle: float,
    centre: ArrayLike = (0.0, 0.0, 0.0),
    axis: ArrayLike = (0.0, 0.0, 1.0),
) -> Array:
    """Camera-to-plate pose when a plate under a fixed camera is turned.

    The world frame turns with the plate, so turning the plate by `angle` moves the camera by
    `-angle` about the same axis.

    Parameters
    ----------
    camera : (4, 4) array_like
        Camera-to-world pose with the plate at angle 0.
    angle : float
        The plate's angle, radians, right-handed about `axis`.
    centre : (3,) array_like
        A point of the turning axis, metres, world frame.
    axis : (3,) array_like
        The axis' direction, world frame, any length.

    Returns
    -------
    (4, 4) ndarray

    Raises
    ------
    TypeError
        If an array does not hold floating point numbers.
    ValueError
        If `camera` is not a rigid motion, `axis` has no length, or a number is not finite.
    """
    camera = rigid_motion("camera", camera)
    centre, axis = finite_array("centre", centre, (3,)), finite_array("axis", axis, (3,))
    length = float(np.linalg.norm(axis))
    if length == 0.0:
        raise ValueError("axis: expected a direction, got the zero vector")
    angle = number("angle", angle)
    x, y, z = axis / length
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    # Rodrigues' formula for the angle -angle
    turn = np.eye(4)
    turn[:3, :3] += -np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
    turn[:3, 3] = centre - turn[:3, :3] @ centre
    return np.asarray(turn @ camera)


def moved(points: Array, motion: Array) -> Array:
    """Return (N, 3) points after a (4, 4) rigid motion."""
    return np.asarray(points @ motion[:3, :3].T + motion[:3, 3])


@dataclass(frozen=True, eq=False)
class _Image:
    """A checked depth image, (H, W), and its pinhole's focal lengths and centre, pixels."""

    depth: Array
    focal: tuple[float, float]
    centre: tuple[float, float]


@dataclass(frozen=True, eq=False)
class View:
    """What one camera saw: points in its frame, and where it stood.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Points in the camera frame (x right, y down, z forward), metres.
    pose : (4, 4) array_like of float
        Camera-to-world rigid motion.
    dropped : int
        How many pixels or points were left out because they were not finite.
    colors : (N, 3) array_like, optional
        The points' colours, red, green and blue from 0 to 1, or uint8: pieces of strings that differ in
        colour are not joined. Views with and without may be mixed.

    Raises
    ------
    TypeError
        If an array does not hold floating point numbers (or, of colours, uint8).
    ValueError
        If `points` is not (N, 3) or not finite, `pose` is not a rigid motion, or `colors` are not one for
        each point, from 0 to 1.
    """

    points: Array
    pose: Array = field(default_factory=lambda: np.eye(4))
    dropped: int = 0
    colors: Array | None = None

    def __post_init__(self) -> None:
        points = finite_array("points", self.points, (None, 3))
        # what the caller does with its array later must not change the view
        object.__setattr__(self, "points", points.copy() if points is self.points else points)
        object.__setattr__(self, "pose", rigid_motion("pose", self.pose).copy())
        if self.colors is not None:
            colors = color_array("colors", self.colors, (len(points), 3))
            object.__setattr__(self, "colors", colors.copy() if colors is self.colors else colors)
        object.__setattr__(self, "dropped", whole("dropped", self.dropped))

    @classmethod
    def from_depth(
        cls,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        pose: ArrayLike | None = None,
        colors: ArrayLike | None = None,
    ) -> View:
        """Un-project a depth image: x = (u - cx) z / fx, y = (v - cy) z / fy.

        The image is copied. Its points are made when they are first asked for; `crop` and `reconstruct` make
        only those in the extraction range.

        Parameters
        ----------
        depth : (H, W) array_like of float
            Depth along the camera's z axis, metres; 0, NaN and infinities are pixels without a
            return. An integer pixel is a pixel centre.
        intrinsics : (3, 3) array_like of float
            The pinhole matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
        pose : (4, 4) array_like of float, optional
            Camera-to-world rigid motion; the identity if not given.
        colors : (H, W, 3) array_like, optional
            The colour image that belongs to it pixel by pixel: red, green and blue from 0 to 1, or uint8.

        Returns
        -------
        View
            Its `dropped` counts the NaN and infinite pixels.

        Raises
        ------
        TypeError
            If an array does not hold floating point numbers (or, of colours, uint8).
        ValueError
            If a shape is wrong, a depth is negative or so great that its point is not finite, the intrinsics
            are not a pinhole's, or a colour is not from 0 to 1.
        """
        image = float_array("depth", depth, (None, None))
        camera = finite_array("intrinsics", intrinsics, (3, 3))
        fx, skew, cx, low, fy, cy, *last = camera.ravel()
        if fx <= 0 or fy <= 0 or skew != 0 or low != 0 or last != [0, 0, 1]:
            raise ValueError(
                "intrinsics: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx, fy > 0, "
                f"got {camera.tolist()}"
            )
        height, width = image.shape
        aside = max(abs(cx), abs(width - 1.0 - cx), abs(cy), abs(height - 1.0 - cy), 1.0)
        # farther points are not finite
        farthest = 0.5 * np.finfo(float).max / aside * min(fx, fy, 1.0)
        copied, dropped = _core.copy_depth(image, farthest)
        seen = None
        if colors is not None:
            seen = color_array("colors", colors, (*image.shape, 3))[np.isfinite(image) & (image > 0)]
        placed = np.eye(4) if pose is None else rigid_motion("pose", as_array("pose", pose)).copy()
        return cls._made(_image=_Image(copied, (fx, fy), (cx, cy)), pose=placed, dropped=dropped, colors=seen)

    @classmethod
    def _made(cls, **fields: object) -> View:
        """Make a view of what has been checked and is no one else's."""
        view = object.__new__(cls)
        view.__dict__.update(fields)
        return view

    def _with(self, points: Array, colors: Array | None) -> View:
        """Return the view with some of its points, its own arrays."""
        return self._made(points=points, pose=self.pose, dropped=self.dropped, colors=colors)

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Array:
            """Un-project a depth image when its points are asked for: most are only cropped."""
            image = self.__dict__.get("_image")
            if name != "points" or image is None:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            points = _core.unproject(image.depth, image.focal, image.centre)
            object.__setattr__(self, "points", points)
            return points

    @classmethod
    def from_world(cls, points: ArrayLike, viewpoint: ArrayLike, colors: ArrayLike | None = None) -> View:
        """Make a view of points that are already in the world frame.

        Parameters
        ----------
        points : (N, 3) array_like of float
            Points in the world frame, metres.
        viewpoint : (3,) array_like of float
            The camera's centre in the world frame, metres.
        colors : (N, 3) array_like, optional
            The points' colours: red, green and blue from 0 to 1, or uint8.

        Returns
        -------
        View
            Its pose is the translation to `viewpoint`, without a rotation.

        Raises
        ------
        TypeError
            If an array does not hold floating point numbers (or, of colours, uint8).
        ValueError
            If a shape is wrong, a number is not finite, or a colour is not from 0 to 1.
        """
        pose = np.eye(4)
        pose[:3, 3] = finite_array("viewpoint", viewpoint, (3,))
        seen = None if colors is None else np.asarray(colors)
        return cls(finite_array("points", points, (None, 3)) - pose[:3, 3], pose, 0, seen)

    @property
    def viewpoint(self) -> Array:
        """(3,) The camera's centre in the world frame, metres."""
        return np.asarray(self.pose[:3, 3])

    @property
    def world_points(self) -> Array:
        """(N, 3) The points in the world frame, metres (eq. 1)."""
        return moved(self.points, self.pose)

    def only(self, chosen: NDArray[np.bool_]) -> View:
        """Return the view with some of its points, (N,) of bool."""
        colors = None if self.colors is None else self.colors[chosen]
        return self._with(self.points[chosen], colors)

    def moved(self, motion: Array) -> View:
        """Return the view, its points shared, after a (4, 4) rigid motion of the world frame."""
        return self._made(**{**self.__dict__, "pose": motion @ self.pose})

    def crop(self, bounds: tuple[ArrayLike, ArrayLike]) -> View:
        """Keep the points inside the extraction range.

        Parameters
        ----------
        bounds : pair of (3,) array_like
            Low and high corner of an axis-aligned box in the world frame, metres; points on its
            faces are kept.

        Returns
        -------
        View

        Raises
        ------
        TypeError
            If the corners are not floating point numbers.
        ValueError
            If a low corner is not below its high one.
        """
        return cropped([self], extraction_range(bounds))[0]


def saw(view: View) -> Array | tuple[Array, tuple[float, float], tuple[float, float]]:
    """Return a view's depth image, focal lengths and centre if nobody asked for its points; else these."""
    if "points" in view.__dict__:
        return view.points
    image = view.__dict__["_image"]
    return image.depth, image.focal, image.centre


def cropped(views: Sequence[View], bounds: tuple[Array, Array]) -> list[View]:
    """Keep the points of views inside a checked extraction range, as `View.crop` does."""
    # what of an image lies outside is not un-projected
    images = {
        i: what
        for i, (view, what) in enumerate(zip(views, map(saw, views), strict=True))
        if isinstance(what, tuple) and view.colors is None
    }
    found = _core.crop_images(
        [depth for depth, *_ in images.values()],
        [(focal, centre) for _, focal, centre in images.values()],
        [views[i].pose for i in images],
        *bounds,
    )
    inside: dict[int, tuple[Array, Array | None]] = {
        i: (points, None) for i, points in zip(images, found, strict=True)
    }
    for i, view in enumerate(views):
        if i not in inside:
            inside[i] = _core.crop(view.points, view.pose, *bounds, view.colors)
    return [view._with(*inside[i]) for i, view in enumerate(views)]


def checked_views(views: Sequence[View]) -> tuple[View, ...]:
    """Return views as a tuple.

    Raises
    ------
    TypeError
        If it is not a sequence of View.
    ValueError
        If it is empty.
    """
    if isinstance(views, View):
        raise TypeError("views: expected a sequence of View, got a single View")
    views = several("views", views, "View")
    for i, view in enumerate(views):
        if not isinstance(view, View):
            raise TypeError(f"views[{i}]: expected a View, got {type(view).__name__}")
    if not views:
        raise ValueError("views: expected at least one View, got none")
    return views


def checked_radius(radius: float) -> float:
    """Return a string's radius, metres.

    Raises
    ------
    TypeError
        If it is not a number.
    ValueError
        If it is not finite and positive.
    """
    if isinstance(radius, bool) or not isinstance(radius, (int, float, np.floating, np.integer)):
        raise TypeError(f"radius: expected a number of metres, got {radius!r}")
    try:
        found = number("radius", radius)
    except ValueError:
        found = 0.0
    if found <= 0:
        raise ValueError(f"radius: expected a positive number of metres, got {radius}")
    return found
