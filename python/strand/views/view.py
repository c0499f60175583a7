"""A view: what one camera saw, and where it stood (eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

import strand._core as _core
from strand.support.checks import (
    Array,
    check_colors,
    check_finite_array,
    check_float_array,
    check_integer,
    check_intrinsics,
    check_mask,
    check_positive,
    check_rigid_motion,
    check_sequence,
    check_small_array,
    freeze_array,
    round_to_millimeters,
    to_array,
)
from strand.views.box import Bounds, Box, extraction_range
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole
from strand.views.pose import moved


class View:
    """What one camera saw: points in its frame, and where it stood. Its arrays are read-only.

    Parameters
    ----------
    points : (N, 3) array_like of float
        Points in the camera frame (x right, y down, z forward), metres. (0, 0, 0) is where the camera is, so
        it is no return, as a depth of 0 is none: organised clouds hold it for such pixels. These points are
        left out.
    pose : (4, 4) array_like, optional
        Camera-to-world rigid motion; the identity if not given.
    dropped : int
        How many pixels or points were left out because they were not finite.
    colors : (N, 3) array_like, optional
        The points' colours, red, green and blue from 0 to 1, or uint8: segments that differ in colour are
        not joined. Views with and without may be mixed.

    Raises
    ------
    TypeError
        If an array does not hold numbers of its kind: floats for points, uint8 or floats for colours.
    ValueError
        If `points` is not (N, 3) or not finite, `pose` is not a rigid motion, or `colors` are not one for
        each point, from 0 to 1.
    """

    __slots__ = ("_colors", "_dropped", "_image", "_points", "_pose")

    def __init__(
        self,
        points: ArrayLike,
        pose: ArrayLike | None = None,
        dropped: int = 0,
        colors: ArrayLike | None = None,
    ) -> None:
        # what the caller does with its arrays later must not change the view
        cloud = check_finite_array("points", points, ("N", 3))
        returned: NDArray[np.bool_] = np.any(cloud, axis=1)
        everywhere = bool(returned.all())
        if not everywhere:
            cloud = cloud[returned]
        self._points: Array | None = freeze_array(cloud, points)
        self._image: DepthImage | None = None
        self._pose = _own_pose(pose)
        self._dropped = check_integer("dropped", dropped)
        self._colors: Array | None = None
        if colors is not None:
            seen = check_colors("colors", colors, (len(returned), 3))
            if not everywhere:
                seen = seen[returned]
            self._colors = freeze_array(seen, colors)

    @classmethod
    def from_depth(
        cls,
        depth: ArrayLike,
        intrinsics: ArrayLike,
        pose: ArrayLike | None = None,
        colors: ArrayLike | None = None,
        *,
        depth_scale: float | None = None,
        mask: ArrayLike | None = None,
    ) -> View:
        """Un-project a depth image: x = (u - cx) z / fx, y = (v - cy) z / fy.

        The image is copied. Its points are made when they are first asked for; `crop` and `reconstruct` make
        only those in the extraction range.

        Parameters
        ----------
        depth : (H, W) array_like
            Depth along the camera's z axis: floats in metres, or, with `depth_scale`, whole numbers or floats
            in its units. 0, NaN and infinities are pixels without a return. An integer pixel is a pixel
            centre.
        intrinsics : (3, 3) array_like
            The pinhole matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
        pose : (4, 4) array_like, optional
            Camera-to-world rigid motion; the identity if not given.
        colors : (H, W, 3) array_like, optional
            The colour image that belongs to it pixel by pixel: red, green and blue from 0 to 1, or uint8.
        depth_scale : float, optional
            Metres for each unit of `depth`, 0.001 for millimetres; needed if `depth` holds whole numbers.
        mask : (H, W) array_like of bool or int, optional
            The ropes' pixels: True, or labels, where 0 is no rope and every other number a rope or a piece of
            one. The view's points are those inside. What is outside is no rope, but was seen: it says which
            space is free. Pixels inside need no depth.

        Returns
        -------
        View
            Its `dropped` counts the NaN and infinite pixels.

        Raises
        ------
        TypeError
            If an array does not hold numbers of its kind, or `depth` holds whole numbers and there is no
            `depth_scale`.
        ValueError
            If a shape is wrong, a depth is negative or so great that its point is not finite, the intrinsics
            are not a pinhole's, `depth_scale` is not positive, a colour is not from 0 to 1, or a label is
            negative.
        """
        image = _in_metres(depth, depth_scale)
        camera = Pinhole.from_matrix(check_intrinsics("intrinsics", intrinsics))
        (fx, fy), (cx, cy) = camera
        height, width = image.shape
        aside = max(abs(cx), abs(width - 1.0 - cx), abs(cy), abs(height - 1.0 - cy), 1.0)
        # farther points are not finite
        farthest = 0.5 * np.finfo(float).max / aside * min(fx, fy, 1.0)
        copied, dropped = _core.copy_depth(image, farthest)
        labels = None if mask is None else check_mask("mask", mask, (height, width))
        taken = DepthImage(copied, camera, _own_pose(pose), labels)
        seen = None
        if colors is not None:
            depths = taken.rope_depth
            seen = check_colors("colors", colors, (height, width, 3))[depths > 0]
        return cls._of(None, taken, taken.pose, dropped, seen)

    @classmethod
    def from_world(cls, points: ArrayLike, viewpoint: ArrayLike, colors: ArrayLike | None = None) -> View:
        """Make a view of points that are already in the world frame.

        Parameters
        ----------
        points : (N, 3) array_like of float
            Points in the world frame, metres. Those at `viewpoint` are no returns, and left out.
        viewpoint : (3,) array_like
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
            If an array does not hold numbers of its kind.
        ValueError
            If a shape is wrong, a number is not finite, or a colour is not from 0 to 1.
        """
        pose = np.eye(4)
        pose[:3, 3] = check_small_array("viewpoint", viewpoint, (3,))
        return cls(check_finite_array("points", points, ("N", 3)) - pose[:3, 3], pose, 0, colors)

    @classmethod
    def _of(
        cls, points: Array | None, image: DepthImage | None, pose: Array, dropped: int, colors: Array | None
    ) -> View:
        """Make a view of what has been checked and is no one else's: points, or the image that holds them."""
        view = cls.__new__(cls)
        for array in (points, pose, colors):
            if array is not None:
                array.setflags(write=False)
        view._points, view._image = points, image
        view._pose, view._dropped, view._colors = pose, dropped, colors
        return view

    @property
    def points(self) -> Array:
        """(N, 3) Points in the camera frame, metres: those inside the mask, if there is one."""
        if self._points is None:
            assert self._image is not None
            points = _core.unproject(self._image.rope_depth, *self._image.camera)
            points.setflags(write=False)
            self._points = points
        return self._points

    @property
    def pose(self) -> Array:
        """(4, 4) Camera-to-world rigid motion."""
        return self._pose

    @property
    def dropped(self) -> int:
        """How many pixels or points were left out because they were not finite."""
        return self._dropped

    @property
    def colors(self) -> Array | None:
        """(N, 3) The points' colours, from 0 to 1; None if they are not known."""
        return self._colors

    @property
    def image(self) -> DepthImage | None:
        """The depth image that the view was made of; None if it was made of points."""
        return self._image

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """(H, W) Which pixels of the depth image are rope; None if that is not known."""
        return None if self._image is None or self._image.labels is None else self._image.mask

    @property
    def measured(self) -> Array | DepthImage:
        """All that was seen, outside of the mask too: points, or the depth image.

        The image, if there is a mask or as long as nobody has asked for its points; else the points.
        """
        image = self._image
        if image is not None and (self._points is None or image.labels is not None):
            return image
        return self.points

    @property
    def viewpoint(self) -> Array:
        """(3,) The camera's centre in the world frame, metres."""
        return np.asarray(self._pose[:3, 3])

    @property
    def world_points(self) -> Array:
        """(N, 3) The points in the world frame, metres (eq. 1)."""
        return moved(self.points, self._pose)

    def __repr__(self) -> str:
        where = round_to_millimeters(self.viewpoint)
        if isinstance(self.measured, DepthImage):
            height, width = self.measured.depth.shape
            masked = "" if self.measured.labels is None else ", masked"
            return f"View(depth image of {width} x {height} pixels{masked}, camera at {where} m)"
        return f"View({len(self.points)} points, camera at {where} m)"

    def only(self, chosen: NDArray[np.bool_]) -> View:
        """Return the view with some of its points.

        Parameters
        ----------
        chosen : (N,) ndarray of bool
            Which points to keep.

        Raises
        ------
        ValueError
            If it is of another shape or kind.
        """
        if np.shape(chosen) != (len(self.points),) or np.asarray(chosen).dtype != np.bool_:
            raise ValueError(f"chosen: expected one bool for each of {len(self.points)} points")
        return self._part(self.points[chosen], None if self._colors is None else self._colors[chosen])

    def moved(self, motion: Array) -> View:
        """Return the view, its points shared, after a (4, 4) rigid motion of the world frame.

        Raises
        ------
        TypeError
            If the motion does not hold real numbers.
        ValueError
            If it is no rigid motion.
        """
        return placed(self, check_rigid_motion("motion", motion) @ self._pose)

    def crop(self, bounds: Bounds) -> View:
        """Keep the points inside the extraction range, and inside the mask if there is one.

        Parameters
        ----------
        bounds : pair of (3,) array_like, or Box
            Low and high corner of a box along the axes of the world frame, metres, or a `strand.Box`, which
            may be turned; points on its faces are kept.

        Returns
        -------
        View

        Raises
        ------
        TypeError
            If the corners are not numbers.
        ValueError
            If a low corner is not below its high one.
        """
        return cropped([self], extraction_range(bounds))[0]

    def _part(self, points: Array, colors: Array | None) -> View:
        """Return the view with some of its points, its own arrays."""
        return self._of(points, None, self._pose, self._dropped, colors)


def _own_pose(pose: ArrayLike | None) -> Array:
    return freeze_array(np.eye(4) if pose is None else check_rigid_motion("pose", pose))


def _in_metres(depth: ArrayLike, depth_scale: float | None) -> Array:
    """(H, W) Depths in metres."""
    image = to_array("depth", depth)
    if depth_scale is not None:
        scale = check_positive("depth_scale", depth_scale)
        if image.dtype.kind not in "fiu":
            raise TypeError(f"depth: expected numbers, got dtype {image.dtype}")
        given = image.astype(np.float64)
        with np.errstate(over="ignore"):
            image = given * scale
        if (np.isfinite(given) & ~np.isfinite(image)).any():
            raise ValueError(
                f"depth: expected depths that are finite in metres, got up to {np.nanmax(given)} units"
            )
    elif image.dtype.kind in "iu":
        raise TypeError(
            f"depth: expected floating point numbers in metres, got dtype {image.dtype}; "
            "depth_scale= says how many metres a unit is, such as 0.001 for millimetres"
        )
    return check_float_array("depth", image, ("H", "W"))


def cropped(views: Sequence[View], bounds: Box) -> tuple[View, ...]:
    """Keep the points of views inside a checked extraction range, as `View.crop` does."""
    motions = [bounds.from_camera(view.pose) for view in views]
    # of a depth image, only the points inside are un-projected
    images = {
        k: view.measured
        for k, view in enumerate(views)
        if isinstance(view.measured, DepthImage) and view.colors is None
    }
    found = _core.crop_images(
        [image.rope_depth for image in images.values()],
        [image.camera for image in images.values()],
        [motions[k] for k in images],
        bounds.low,
        bounds.high,
    )
    points = dict(zip(images, found, strict=True))
    return tuple(
        view._part(points[k], None)
        if k in points
        else view._part(*_core.crop_points(view.points, motions[k], bounds.low, bounds.high, view.colors))
        for k, view in enumerate(views)
    )


def masked(view: View, image: DepthImage) -> View:
    """Return a view with only the points that the mask of its image, or of one made of its points, shows."""
    if view.image is not None:
        colors = None if view.colors is None else view.colors[image.mask[image.depth > 0]]
        return View._of(None, image, view.pose, view.dropped, colors)
    columns, rows = np.rint(image.project(view.world_points)).astype(np.int64).T
    height, width = image.mask.shape
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    inside[inside] = image.mask[rows[inside], columns[inside]]
    return view.only(inside)


def placed(view: View, pose: Array) -> View:
    """Return a view as if it had come with another pose, (4, 4), camera to world."""
    image = None if view.image is None else replace(view.image, pose=pose)
    return View._of(view._points, image, pose, view.dropped, view.colors)


def pictured(view: View, image: DepthImage) -> View:
    """Return a view of a depth image as if it had been made of another one, without colours."""
    return View._of(None, image, view.pose, view.dropped, None)


def check_views(views: Sequence[View]) -> tuple[View, ...]:
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
    views = check_sequence("views", views, "View")
    for i, view in enumerate(views):
        if not isinstance(view, View):
            raise TypeError(f"views[{i}]: expected a View, got {type(view).__name__}")
    if not views:
        raise ValueError("views: expected at least one View, got none")
    return views
