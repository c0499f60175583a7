"""A view: the points that one camera saw, and its pose (eq. 1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

import strand._core as _core
from strand.support.checks import (
    Array,
    check_colors,
    check_finite_array,
    check_integer,
    check_intrinsics,
    check_mask,
    check_occluders,
    check_rigid_motion,
    check_sequence,
    check_small_array,
    check_stamp,
    freeze_array,
    round_to_millimeters,
    to_array,
)
from strand.views.box import Bounds, Box, make_box
from strand.views.depth_image import DepthImage, check_depth, list_points
from strand.views.pinhole import Pinhole
from strand.views.pose import moved


class View:
    """The points that one camera saw, in its frame, and its pose. The arrays are read-only.

    Parameters
    ----------
    points : (N, 3) or (H, W, 3) array_like of float
        Points in the camera frame (x right, y down, z forward), metres. Points at (0, 0, 0) are dropped:
        organised clouds, (H, W, 3), have them, NaN or infinities where a pixel has no return.
    pose : (4, 4) array_like, optional
        Camera-to-world rigid motion; the identity by default.
    dropped : int
        The number of pixels or points that the caller dropped because they were not finite.
    colors : (N, 3) or (H, W, 3) array_like, optional
        The points' colours: red, green and blue from 0 to 1, or uint8. Segments with different colours are
        not joined. Views with and without colours may be mixed.
    stamp : float, optional
        Time of the image, seconds since 1970 or on a clock of the caller's.

    Raises
    ------
    TypeError
        If an array does not hold numbers of its kind: floats for points, uint8 or floats for colours.
    ValueError
        If `points` is not (N, 3) or not finite, `pose` is not a rigid motion, `colors` are not one for
        each point, from 0 to 1, or `stamp` is as large as nanoseconds.

    Examples
    --------
    >>> import numpy as np
    >>> import strand
    >>> depth = np.full((3, 4), 0.5)
    >>> strand.View.from_depth(depth, intrinsics=[[600, 0, 1.5], [0, 600, 1], [0, 0, 1]])
    View(depth image of 4 x 3 pixels, camera at [0.0, 0.0, 0.0] m)
    """

    __slots__ = ("_colors", "_dropped", "_image", "_points", "_pose", "_stamp")

    def __init__(
        self,
        points: ArrayLike,
        pose: ArrayLike | None = None,
        dropped: int = 0,
        colors: ArrayLike | None = None,
        *,
        stamp: float | None = None,
    ) -> None:
        # later changes of the caller's arrays must not change the view
        dropped = check_integer("dropped", dropped)
        if to_array("points", points).ndim == 3:
            points, colors, missing = list_points(points, colors)
            dropped += missing
        cloud = check_finite_array("points", points, ("N", 3))
        returned: NDArray[np.bool_] = np.any(cloud, axis=1)
        everywhere = bool(returned.all())
        if not everywhere:
            cloud = cloud[returned]
        self._points: Array | None = freeze_array(cloud, points)
        self._image: DepthImage | None = None
        self._pose = _check_pose(pose)
        self._dropped = dropped
        self._stamp = check_stamp("stamp", stamp)
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
        occluders: ArrayLike | None = None,
        stamp: float | None = None,
    ) -> View:
        """Return a view of a depth image: x = (u - cx) z / fx, y = (v - cy) z / fy.

        strand copies the image and un-projects it when the points are first needed. `crop` and `reconstruct`
        un-project only the points in the extraction range.

        Parameters
        ----------
        depth : (H, W) array_like
            Depth along the camera's z axis: floats in metres, or whole numbers or floats in units of
            `depth_scale`. 0, NaN and infinities mean no return. An integer pixel is a pixel centre.
        intrinsics : (3, 3) array_like
            The pinhole matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], pixels.
        pose : (4, 4) array_like, optional
            Camera-to-world rigid motion; the identity by default.
        colors : (H, W, 3) array_like, optional
            The colour of each pixel: red, green and blue from 0 to 1, or uint8.
        depth_scale : float, optional
            Metres for each unit of `depth`, such as 0.001 for millimetres. Whole numbers need it.
        mask : (H, W) array_like of bool or int, optional
            The ropes' pixels: True, or labels, where 0 is no rope and every other number is a rope or a piece
            of one. Pixels inside need no depth. The view's points are those inside the mask; depths outside
            still show which space is free.
        occluders : (H, W) array_like of bool or int, optional
            The pixels of the robot or of a hand, for instance from the robot's own model: True, or any number
            but 0. They are no rope, whatever `mask` says, and their depths are dropped. Space behind them is
            hidden, not free: a rope may go on there, and where it ends there, `Chain.hidden_ends` says so.
        stamp : float, optional
            Time of the image, seconds, as in `View`.

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
            If a shape is wrong, a depth is negative or so large that its point is not finite, the intrinsics
            are not a pinhole's, `depth_scale` is not positive, a colour is not from 0 to 1, a label is
            negative, or `stamp` is as large as nanoseconds.
        """
        taken_at = check_stamp("stamp", stamp)
        image, scale = check_depth(depth, depth_scale)
        camera = Pinhole.from_matrix(check_intrinsics("intrinsics", intrinsics))
        (fx, fy), (cx, cy) = camera
        height, width = image.shape
        aside = max(abs(cx), abs(width - 1.0 - cx), abs(cy), abs(height - 1.0 - cy), 1.0)
        # farther points are not finite
        farthest = 0.5 * np.finfo(float).max / aside * min(fx, fy, 1.0)
        copied, dropped = _core.copy_depth(image, farthest, scale)
        labels = None if mask is None else check_mask("mask", mask, (height, width))
        hiding = None
        if occluders is not None:
            hiding = check_occluders("occluders", occluders, (height, width))
            copied = np.where(hiding, 0.0, copied)
        seen, pixels = None, None
        if colors is not None:
            everywhere = to_array("colors", colors)
            whole = everywhere.dtype == np.uint8 and everywhere.shape == (height, width, 3)
            everywhere = everywhere if whole else check_colors("colors", everywhere, (height, width, 3))
            pixels = np.array(everywhere if whole else np.rint(255.0 * everywhere), dtype=np.uint8, order="C")
        taken = DepthImage(copied, camera, _check_pose(pose), labels, pixels, hiding)
        if colors is not None:
            seen = everywhere.reshape(-1, 3).take(np.flatnonzero(taken.rope_depth > 0), axis=0)
            seen = seen / 255.0 if seen.dtype == np.uint8 else seen
        return cls._build(None, taken, taken.pose, dropped, seen, taken_at)

    @classmethod
    def from_world(
        cls,
        points: ArrayLike,
        viewpoint: ArrayLike,
        colors: ArrayLike | None = None,
        *,
        stamp: float | None = None,
    ) -> View:
        """Return a view of points that are already in the world frame.

        Parameters
        ----------
        points : (N, 3) array_like of float
            Points in the world frame, metres. Points at `viewpoint` are dropped.
        viewpoint : (3,) array_like
            The camera's centre in the world frame, metres.
        colors : (N, 3) array_like, optional
            The points' colours: red, green and blue from 0 to 1, or uint8.
        stamp : float, optional
            Time of the points, seconds, as in `View`.

        Returns
        -------
        View
            Its pose is the translation to `viewpoint`, without a rotation.

        Raises
        ------
        TypeError
            If an array does not hold numbers of its kind.
        ValueError
            If a shape is wrong, a number is out of range or not finite, or a colour is not from 0 to 1.
        """
        pose = np.eye(4)
        pose[:3, 3] = check_small_array("viewpoint", viewpoint, (3,))
        return cls(check_finite_array("points", points, ("N", 3)) - pose[:3, 3], pose, 0, colors, stamp=stamp)

    @classmethod
    def _build(
        cls,
        points: Array | None,
        image: DepthImage | None,
        pose: Array,
        dropped: int,
        colors: Array | None,
        stamp: float | None,
    ) -> View:
        """Return a view of checked arrays that nobody else changes: points, or the image that holds them."""
        view = cls.__new__(cls)
        for array in (points, pose, colors):
            if array is not None:
                array.setflags(write=False)
        view._points, view._image = points, image
        view._pose, view._dropped, view._colors, view._stamp = pose, dropped, colors, stamp
        return view

    def _change(
        self, points: Array | None, image: DepthImage | None, pose: Array, colors: Array | None
    ) -> View:
        """Return a view of other checked arrays from the same measurement."""
        return self._build(points, image, pose, self._dropped, colors, self._stamp)

    @property
    def points(self) -> Array:
        """(N, 3) Points in the camera frame, metres: those inside the mask, if there is one."""
        if self._points is None:
            assert self._image is not None
            mask = None if self._image.labels is None else self._image.mask
            points = _core.unproject(self._image.depth, *self._image.camera, mask)
            points.setflags(write=False)
            self._points = points
        return self._points

    @property
    def pose(self) -> Array:
        """(4, 4) Camera-to-world rigid motion."""
        return self._pose

    @property
    def dropped(self) -> int:
        """The number of pixels or points that were dropped because they were not finite."""
        return self._dropped

    @property
    def stamp(self) -> float | None:
        """Time of the image, seconds; None if unknown."""
        return self._stamp

    @property
    def colors(self) -> Array | None:
        """(N, 3) The points' colours, from 0 to 1; None if unknown."""
        return self._colors

    @property
    def image(self) -> DepthImage | None:
        """The depth image of a view that was made of one; else None."""
        return self._image

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """(H, W) The ropes' pixels in the depth image; None without a mask or an image."""
        return None if self._image is None or self._image.labels is None else self._image.mask

    @property
    def measured(self) -> Array | DepthImage:
        """All that the camera measured, outside the mask too: points or the depth image.

        It is the image if there is a mask or an occluder, or while its points have not been needed.
        """
        image = self._image
        if image is None:
            return self.points
        if self._points is None or image.labels is not None or image.occluders is not None:
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
            occluded = "" if self.measured.occluders is None else ", with occluders"
            return f"View(depth image of {width} x {height} pixels{masked}{occluded}, camera at {where} m)"
        return f"View({len(self.points)} points, camera at {where} m)"

    def select(self, chosen: NDArray[np.bool_]) -> View:
        """Return the view with some of its points: those where `chosen`, (N,) bool, is True.

        Raises
        ------
        ValueError
            If `chosen` has another shape or type.
        """
        chosen = to_array("chosen", chosen)
        if chosen.shape != (len(self.points),) or chosen.dtype != np.bool_:
            raise ValueError(f"chosen: expected one bool for each of {len(self.points)} points")
        colors = None if self._colors is None else self._colors[chosen]
        return self._replace_points(np.compress(chosen, self.points, axis=0), colors)

    def moved(self, motion: Array) -> View:
        """Return the view after a (4, 4) rigid motion of the world frame. It shares its points.

        Raises
        ------
        TypeError
            If the motion does not hold real numbers.
        ValueError
            If it is not a rigid motion.
        """
        return placed(self, check_rigid_motion("motion", motion) @ self._pose)

    def crop(self, bounds: Bounds) -> View:
        """Return the view with only the points inside the extraction range, and inside the mask if any.

        Parameters
        ----------
        bounds : pair of (3,) array_like, or Box
            Low and high corner of a box along the axes of the world frame, metres, or a `strand.Box`, which
            may be turned. Points on its faces are kept.

        Raises
        ------
        TypeError
            If the corners are not numbers.
        ValueError
            If a low corner is not below its high one.
        """
        return cropped([self], make_box(bounds))[0]

    def _replace_points(self, points: Array, colors: Array | None) -> View:
        """Return the view with other points, and without an image."""
        return self._change(points, None, self._pose, colors)


def _check_pose(pose: ArrayLike | None) -> Array:
    return freeze_array(np.eye(4) if pose is None else check_rigid_motion("pose", pose))


def cropped(views: Sequence[View], bounds: Box) -> tuple[View, ...]:
    """Return views with only the points inside a checked extraction range, as `View.crop` does."""
    # the poses of views are checked
    motions = [view.pose if bounds.pose is None else bounds.express_pose(view.pose) for view in views]
    # of depth images, only the points inside are un-projected
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
    inside: dict[int, tuple[Array, Array | None]] = {
        k: (points, None) for k, points in zip(images, found, strict=True)
    }
    for k, view in enumerate(views):
        if k not in inside:
            inside[k] = _core.crop_points(view.points, motions[k], bounds.low, bounds.high, view.colors)
    return tuple(view._replace_points(*inside[k]) for k, view in enumerate(views))


def masked(view: View, image: DepthImage) -> View:
    """Return a view with only the points that the mask of its image, or of one made of its points, shows."""
    if view.image is not None:
        colors = None if view.colors is None else view.colors[image.mask[image.depth > 0]]
        return view._change(None, image, view.pose, colors)
    rows, columns, inside = image.find_pixels(view.world_points)
    inside[inside] = image.mask[rows[inside], columns[inside]]
    return view.select(inside)


def placed(view: View, pose: Array) -> View:
    """Return a view with another pose, (4, 4), camera to world."""
    image = None if view.image is None else view.image.placed(pose)
    return view._change(view._points, image, pose, view.colors)


def pictured(view: View, image: DepthImage) -> View:
    """Return a view with another depth image, without colours."""
    return view._change(None, image, view.pose, None)


def seen_from(view: View, image: DepthImage) -> View:
    """Return a view of points in the frame of an image from the same place, without the image."""
    points = view.points @ (view.pose[:3, :3].T @ image.pose[:3, :3])
    return view._change(points, None, image.pose.copy(), view.colors)


def seen_in(view: View, image: DepthImage) -> View:
    """Return a view of points in the frame of an image that shows them, with the image."""
    moved_view = seen_from(view, image)
    return view._change(moved_view.points, image, moved_view.pose, view.colors)


def check_views(views: Sequence[View]) -> tuple[View, ...]:
    """Return views as a tuple after checking them.

    Raises
    ------
    TypeError
        If they are not a sequence of View.
    ValueError
        If there are none.
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
