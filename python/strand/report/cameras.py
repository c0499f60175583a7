"""Give each view a camera and a depth image to draw over, made from its points if it has no image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.ropes.model import Model
from strand.support.checks import Array, check_instance
from strand.views.pinhole import Pinhole
from strand.views.view import View

_MIN_SIDE = 40  # of an image made from points, pixels
_MAX_SIDE = 480  # of an image made from points, pixels
_PIXELS_PER_POINT = 3.0  # of an image made from points
_MAX_TANGENT = np.tan(np.radians(70.0))  # points at larger angles to the view's direction are not drawn
_OUTER_SHARE = 0.005  # of the points on each side that may lie outside the image
_MARGIN = 0.1  # around the points, of the image's side
_MIN_SPAN = 1e-6  # of the points, as a tangent


@dataclass(frozen=True, eq=False)
class Camera:
    """The camera of a view in its registered pose, and its depth image.

    Attributes
    ----------
    pose : (4, 4) ndarray
        Camera to world.
    pinhole : Pinhole
    depth : (H, W) ndarray
        Metres; 0 without a return.
    imagined : bool
        Whether the view had only points: the camera then looks from the viewpoint at their median.
    """

    pose: Array
    pinhole: Pinhole
    depth: Array
    imagined: bool

    @property
    def viewpoint(self) -> Array:
        """(3,) World frame, metres."""
        return np.asarray(self.pose[:3, 3])

    def project(self, points: Array) -> tuple[Array, Array]:
        """Return (M, 2) columns and rows, pixels, and (M,) depths, metres, of points in the world frame.

        The pixels of points behind the camera are NaN.
        """
        x, y, z = ((points - self.viewpoint) @ self.pose[:3, :3]).T
        return self.pinhole.project(np.column_stack([x, y, np.where(z > 0, z, np.nan)])), z

    def find_corners(self, distance: float) -> Array:
        """Return (4, 3) the image's corners at a depth, in order around it, world frame, metres."""
        height, width = self.depth.shape
        columns = np.array([-0.5, width - 0.5, width - 0.5, -0.5])
        rows = np.array([-0.5, -0.5, height - 0.5, height - 0.5])
        rays = self.pinhole.cast_rays(rows, columns)
        return np.asarray(self.viewpoint + distance * rays @ self.pose[:3, :3].T)


def make_cameras(model: Model, views: Sequence[View]) -> list[Camera | None]:
    """Return the camera of each view in the model's pose; None for a view without image and points."""
    check_instance("model", model, Model)
    if len(model.poses) != len(views):
        raise ValueError(f"views: expected the {len(model.poses)} views of the model, got {len(views)}")
    return [_make_camera(view, pose) for view, pose in zip(views, model.poses, strict=True)]


def _make_camera(view: View, pose: Array) -> Camera | None:
    if view.image is not None:
        return Camera(pose, view.image.camera, view.image.depth, False)
    if not len(view.points):
        return None
    middle = np.median(view.points, axis=0)
    away = float(np.linalg.norm(middle))
    forward = middle / away if away > 0 else np.array([0.0, 0.0, 1.0])
    # keep rows and columns close to the axes of the view's frame
    aside = np.eye(3)[0 if abs(forward[0]) < 0.9 else 1]
    right = aside - (aside @ forward) * forward
    right /= np.linalg.norm(right)
    turn = np.column_stack([right, np.cross(forward, right), forward])
    x, y, z = (view.points @ turn).T
    seen = (z > 0) & (np.hypot(x, y) < _MAX_TANGENT * z)
    turned = np.eye(4)
    turned[:3, :3] = turn
    if not seen.any():
        return None
    x, y, z = x[seen] / z[seen], y[seen] / z[seen], z[seen]
    low, high = np.quantile(np.column_stack([x, y]), [_OUTER_SHARE, 1.0 - _OUTER_SHARE], axis=0)
    span = float(max((high - low).max(), _MIN_SPAN))
    side = float(np.clip(np.sqrt(len(x) * _PIXELS_PER_POINT), _MIN_SIDE, _MAX_SIDE))
    focal, margin = side / (1.2 * span), _MARGIN * side
    left, top = margin - focal * low
    width, height = (np.ceil(focal * (high - low) + 2 * margin)).astype(int).tolist()
    depth = np.full((height, width), np.inf)
    columns, rows = np.rint(focal * x + left).astype(int), np.rint(focal * y + top).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    np.minimum.at(depth, (rows[inside], columns[inside]), z[inside])
    depth[np.isinf(depth)] = 0.0
    return Camera(pose @ turned, Pinhole((focal, focal), (left, top)), depth, True)
