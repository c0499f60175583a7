"""Usual mistakes in what is handed over, undone: what the views would be if each had been made."""

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

# camera frames of other conventions, as rotations into x right, y down, z forward
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
        Of the doubt that it raises.
    suspected : str
        What it looks like, and what to do.
    undone : callable
        Returns views as they would be without it, in their order; None for one with which it cannot have been
        made.
    """

    kind: str
    suspected: str
    undone: Callable[[Sequence[View]], list[View | None]]


def _each(undone: Callable[[View], View | None]) -> Callable[[Sequence[View]], list[View | None]]:
    return lambda views: [undone(view) for view in views]


def _inverse_pose(view: View) -> View:
    turn, shift = view.pose[:3, :3].T, view.pose[:3, 3]
    return placed(view, _pose(turn, -turn @ shift))


def _pose_in_millimetres(view: View) -> View:
    return placed(view, _pose(view.pose[:3, :3], 1e-3 * view.pose[:3, 3]))


def _depth_in_millimetres(view: View) -> View:
    if view.image is None:
        return View(1e-3 * view.points, view.pose)
    return pictured(view, replace(view.image, depth=1e-3 * view.image.depth))


def _all_in_millimetres(view: View) -> View:
    return _pose_in_millimetres(_depth_in_millimetres(view))


def _in_world_frame(view: View) -> View | None:
    return (
        None if view.image is not None or _from_world(view) else View.from_world(view.points, view.viewpoint)
    )


def _other_axes(turn: Array) -> Callable[[View], View | None]:
    return lambda view: (
        None if _from_world(view) else placed(view, _pose(view.pose[:3, :3] @ turn, view.pose[:3, 3]))
    )


def _image(change: Callable[[NDArray[Any]], NDArray[Any]]) -> Callable[[View], View | None]:
    """Change the pixels of depth and mask."""

    def undone(view: View) -> View | None:
        image = view.image
        if image is None:
            return None
        labels = None if image.labels is None else np.ascontiguousarray(change(image.labels))
        return pictured(view, replace(image, depth=np.ascontiguousarray(change(image.depth)), labels=labels))

    return undone


def _centred(view: View) -> View | None:
    """Scale intrinsics so that their centre is the image's."""
    image = view.image
    if image is None or min(image.camera.center) <= 0:
        return None
    height, width = image.depth.shape
    (fx, fy), (cx, cy) = image.camera
    focal = fx * (width / (2.0 * cx)), fy * (height / (2.0 * cy))
    centered = Pinhole(focal, (0.5 * (width - 1), 0.5 * (height - 1)))
    return pictured(view, replace(image, camera=centered))


def _over_rays(view: View) -> View | None:
    image = view.image
    if image is None:
        return None
    return pictured(view, replace(image, depth=image.depth / ray_lengths(image)))


def ray_lengths(image: DepthImage) -> Array:
    """(H, W) How long the ray of each pixel is up to a depth of one."""
    x, y, _ = np.moveaxis(image.camera.rays(*np.indices(image.depth.shape)), -1, 0)
    return np.asarray(np.sqrt(1.0 + x**2 + y**2))


def _of_neighbours(step: int) -> Callable[[Sequence[View]], list[View | None]]:
    return lambda views: [
        placed(view, views[(number + step) % len(views)].pose) for number, view in enumerate(views)
    ]


def _from_world(view: View) -> bool:
    """Whether a view may be of points in the world frame, which has a camera's place, but no camera frame."""
    return view.image is None and np.array_equal(view.pose[:3, :3], np.eye(3)) and bool(view.viewpoint.any())


def _pose(turn: Array, shift: Array) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, shift
    return pose


IN_MILLIMETRES = Mistake(
    "range", "points and poses look like millimetres: give both in metres", _each(_all_in_millimetres)
)
"""One that views alone cannot show: they agree, in any unit."""

MISTAKES = (
    Mistake(
        "depth",
        "depths look like millimetres: give depth_scale=0.001, or points * 0.001",
        _each(_depth_in_millimetres),
    ),
    Mistake(
        "pose",
        "the poses' translations look like millimetres: give them in metres",
        _each(_pose_in_millimetres),
    ),
    Mistake("viewpoint", "points look like world-frame ones: use View.from_world", _each(_in_world_frame)),
    Mistake(
        "pose",
        "poses look like world-to-camera ones: give their inverses, camera-to-world",
        _each(_inverse_pose),
    ),
    Mistake(
        "pose",
        "poses look off by one: each view seems to have that of the view before it",
        _of_neighbours(1),
    ),
    Mistake(
        "pose",
        "poses look off by one: each view seems to have that of the view after it",
        _of_neighbours(-1),
    ),
    *(
        Mistake(
            "pose",
            f"the camera frame looks like {name}: turn it to x right, y down, z forward",
            _each(_other_axes(turn)),
        )
        for name, turn in _AXES.items()
    ),
    Mistake(
        "depth",
        "depth looks mirrored, left to right: give depth[:, ::-1]",
        _each(_image(lambda pixels: pixels[:, ::-1])),
    ),
    Mistake(
        "depth",
        "depth looks upside down: give depth[::-1]",
        _each(_image(lambda pixels: pixels[::-1])),
    ),
    Mistake(
        "depth",
        "depth looks turned by half a turn: give depth[::-1, ::-1]",
        _each(_image(lambda pixels: pixels[::-1, ::-1])),
    ),
    Mistake(
        "depth",
        "depth looks transposed, rows for columns: give depth.T",
        _each(_image(lambda pixels: pixels.T)),
    ),
    Mistake(
        "intrinsics",
        "intrinsics look like those of an image of another size: scale fx, fy, cx, cy with it",
        _each(_centred),
    ),
    Mistake(
        "depth",
        "depth looks as if it was measured along the rays: divide it by their lengths",
        _each(_over_rays),
    ),
)
"""Those that views contradict."""
