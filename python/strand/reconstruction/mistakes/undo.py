"""Usual mistakes in the input, and how to undo each: the views as they are if it was made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole
from strand.views.view import View, pictured, placed

# camera frames of other conventions, as rotations to x right, y down, z forward
_AXES = {
    "x right, y up, z backward": np.diag([1.0, -1.0, -1.0]),
    "x forward, y left, z up": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}


@dataclass(frozen=True)
class Mistake:
    """A usual mistake.

    Attributes
    ----------
    kind : str
        The kind of the doubt that it raises.
    advice : str
        What the input looks like, and what to give instead.
    undo : callable
        Returns views without the mistake, in their order; None for a view in which nobody can have made it.
    """

    kind: str
    advice: str
    undo: Callable[[Sequence[View]], list[View | None]]


def _undo_each(undo: Callable[[View], View | None]) -> Callable[[Sequence[View]], list[View | None]]:
    return lambda views: [undo(view) for view in views]


def _invert_pose(view: View) -> View:
    turn, shift = view.pose[:3, :3].T, view.pose[:3, 3]
    return placed(view, _make_pose(turn, -turn @ shift))


def _scale_pose(view: View) -> View:
    return placed(view, _make_pose(view.pose[:3, :3], 1e-3 * view.pose[:3, 3]))


def _scale_depth(view: View) -> View:
    if view.image is None:
        return View(1e-3 * view.points, view.pose)
    return pictured(view, replace(view.image, depth=1e-3 * view.image.depth))


def _scale_all(view: View) -> View:
    return _scale_pose(_scale_depth(view))


def _take_as_world_points(view: View) -> View | None:
    if view.image is not None or _may_be_world_frame(view):
        return None
    return View.from_world(view.points, view.viewpoint)


def _turn_axes(turn: Array) -> Callable[[View], View | None]:
    def undo(view: View) -> View | None:
        if _may_be_world_frame(view):
            return None
        return placed(view, _make_pose(view.pose[:3, :3] @ turn, view.pose[:3, 3]))

    return undo


def _change_pixels(change: Callable[[NDArray[Any]], NDArray[Any]]) -> Callable[[View], View | None]:
    """Return a function that undoes a mistake in the order of the pixels of depth and mask."""

    def undo(view: View) -> View | None:
        image = view.image
        if image is None:
            return None
        labels, occluders = (
            None if pixels is None else np.ascontiguousarray(change(pixels))
            for pixels in (image.labels, image.occluders)
        )
        depth = np.ascontiguousarray(change(image.depth))
        return pictured(view, replace(image, depth=depth, labels=labels, colors=None, occluders=occluders))

    return undo


def _center_intrinsics(view: View) -> View | None:
    """Scale intrinsics so that the principal point is the middle of the image."""
    image = view.image
    if image is None or min(image.camera.center) <= 0:
        return None
    height, width = image.depth.shape
    (fx, fy), (cx, cy) = image.camera
    focal = fx * (width / (2.0 * cx)), fy * (height / (2.0 * cy))
    centered = Pinhole(focal, (0.5 * (width - 1), 0.5 * (height - 1)))
    return pictured(view, replace(image, camera=centered))


def _divide_by_rays(view: View) -> View | None:
    image = view.image
    if image is None:
        return None
    return pictured(view, replace(image, depth=image.depth / measure_ray_lengths(image)))


def measure_ray_lengths(image: DepthImage) -> Array:
    """(H, W) Return the length of each pixel's ray to a depth of one."""
    x, y, _ = np.moveaxis(image.camera.cast_rays(*np.indices(image.depth.shape)), -1, 0)
    return np.asarray(np.sqrt(1.0 + x**2 + y**2))


def _shift_poses(step: int) -> Callable[[Sequence[View]], list[View | None]]:
    return lambda views: [
        placed(view, views[(number + step) % len(views)].pose) for number, view in enumerate(views)
    ]


def _may_be_world_frame(view: View) -> bool:
    """Tell whether a view may come from points of the world frame: then its axes are those of the world."""
    return view.image is None and np.array_equal(view.pose[:3, :3], np.eye(3)) and bool(view.viewpoint.any())


def _make_pose(turn: Array, shift: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


IN_MILLIMETERS = Mistake(
    "range", "points and poses look like millimetres: give both in metres", _undo_each(_scale_all)
)
"""The mistake that views alone do not show, as they agree in any unit."""

MISTAKES = (
    Mistake(
        "depth",
        "depths look like millimetres: give depth_scale=0.001, or points * 0.001",
        _undo_each(_scale_depth),
    ),
    Mistake(
        "pose",
        "the poses' translations look like millimetres: give them in metres",
        _undo_each(_scale_pose),
    ),
    Mistake(
        "viewpoint",
        "points look like world-frame ones: use View.from_world",
        _undo_each(_take_as_world_points),
    ),
    Mistake(
        "pose",
        "poses look like world-to-camera ones: give their inverses, camera-to-world",
        _undo_each(_invert_pose),
    ),
    Mistake(
        "pose",
        "poses look off by one: each view seems to have that of the view before it",
        _shift_poses(1),
    ),
    Mistake(
        "pose",
        "poses look off by one: each view seems to have that of the view after it",
        _shift_poses(-1),
    ),
    *(
        Mistake(
            "pose",
            f"the camera frame looks like {name}: turn it to x right, y down, z forward",
            _undo_each(_turn_axes(turn)),
        )
        for name, turn in _AXES.items()
    ),
    Mistake(
        "depth",
        "depth looks mirrored, left to right: give depth[:, ::-1]",
        _undo_each(_change_pixels(lambda pixels: pixels[:, ::-1])),
    ),
    Mistake(
        "depth",
        "depth looks upside down: give depth[::-1]",
        _undo_each(_change_pixels(lambda pixels: pixels[::-1])),
    ),
    Mistake(
        "depth",
        "depth looks turned by half a turn: give depth[::-1, ::-1]",
        _undo_each(_change_pixels(lambda pixels: pixels[::-1, ::-1])),
    ),
    Mistake(
        "depth",
        "depth looks transposed, rows for columns: give depth.T",
        _undo_each(_change_pixels(lambda pixels: pixels.T)),
    ),
    Mistake(
        "intrinsics",
        "intrinsics look like those of an image of another size: scale fx, fy, cx, cy with it",
        _undo_each(_center_intrinsics),
    ),
    Mistake(
        "depth",
        "depth looks as if it was measured along the rays: divide it by their lengths",
        _undo_each(_divide_by_rays),
    ),
)
"""The mistakes with which views do not agree."""
