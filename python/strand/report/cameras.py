"""What each camera saw, as an image that lines can be drawn over: its own, or one made of its points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.ropes.model import Model
from strand.support.checks import Array
from strand.views.pinhole import Pinhole
from strand.views.view import View

# an image that is made of points: pixels on its longer side, and for each point
_LARGEST, _PIXELS_A_POINT = 480, 3.0
# points farther aside are not drawn, nor the least and the greatest share of the others
_WIDEST, _ASIDE = np.tan(np.radians(70.0)), 0.005


@dataclass(frozen=True, eq=False)
class Camera:
    """One view's camera in its corrected pose, and the depth image that it took.

    Attributes
    ----------
    pose : (4, 4) ndarray
        Camera to world.
    pinhole : Pinhole
    depth : (H, W) ndarray
        Metres; 0 where there is no return.
    imagined : bool
        Whether the view came as points: the camera then looks from its viewpoint at their middle.
    """

    pose: Array
    pinhole: Pinhole
    depth: Array
    imagined: bool

    @property
    def viewpoint(self) -> Array:
        """(3,) World frame, metres."""
        return np.asarray(self.pose[:3, 3])

    def projected(self, points: Array) -> tuple[Array, Array]:
        """(M, 2) Columns and rows of points of the world, pixels, and (M,) their depths, metres.

        Points that are not before the camera have NaN for pixels.
        """
        x, y, z = ((points - self.viewpoint) @ self.pose[:3, :3]).T
        return self.pinhole.project(np.column_stack([x, y, np.where(z > 0, z, np.nan)])), z

    def corners(self, distance: float) -> Array:
        """(4, 3) The image's corners at a depth, in order around it, world frame, metres."""
        height, width = self.depth.shape
        columns = np.array([-0.5, width - 0.5, width - 0.5, -0.5])
        rows = np.array([-0.5, -0.5, height - 0.5, height - 0.5])
        rays = self.pinhole.rays(rows, columns)
        return np.asarray(self.viewpoint + distance * rays @ self.pose[:3, :3].T)


def make_cameras(model: Model, views: Sequence[View]) -> list[Camera | None]:
    """Return each view's camera in the model's pose; None where a view has neither an image nor points.

    Raises
    ------
    ValueError
        If the model has not one pose for each view.
    """
    if len(model.poses) != len(views):
        raise ValueError(
            f"views: expected the {len(model.poses)} that the model was made from, got {len(views)}"
        )
    return [_camera(view, pose) for view, pose in zip(views, model.poses, strict=True)]


def _camera(view: View, pose: Array) -> Camera | None:
    if view.image is not None:
        return Camera(pose, view.image.camera, view.image.depth, False)
    if not len(view.points):
        return None
    middle = np.median(view.points, axis=0)
    away = float(np.linalg.norm(middle))
    forward = middle / away if away > 0 else np.array([0.0, 0.0, 1.0])
    # rows and columns stay as near to the axes of the view's frame as they can
    aside = np.eye(3)[0 if abs(forward[0]) < 0.9 else 1]
    right = aside - (aside @ forward) * forward
    right /= np.linalg.norm(right)
    turn = np.column_stack([right, np.cross(forward, right), forward])
    x, y, z = (view.points @ turn).T
    seen = (z > 0) & (np.hypot(x, y) < _WIDEST * z)
    turned = np.eye(4)
    turned[:3, :3] = turn
    if not seen.any():
        return None
    x, y, z = x[seen] / z[seen], y[seen] / z[seen], z[seen]
    low, high = np.quantile(np.column_stack([x, y]), [_ASIDE, 1.0 - _ASIDE], axis=0)
    span = float(max((high - low).max(), 1e-6))
    side = float(np.clip(np.sqrt(len(x) * _PIXELS_A_POINT), 40, _LARGEST))
    focal, margin = side / (1.2 * span), 0.1 * side
    left, top = margin - focal * low
    width, height = (np.ceil(focal * (high - low) + 2 * margin)).astype(int).tolist()
    depth = np.full((height, width), np.inf)
    columns, rows = np.rint(focal * x + left).astype(int), np.rint(focal * y + top).astype(int)
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    np.minimum.at(depth, (rows[inside], columns[inside]), z[inside])
    depth[np.isinf(depth)] = 0.0
    return Camera(pose @ turned, Pinhole((focal, focal), (left, top)), depth, True)


def find_seen_side(points: Array, viewpoints: Array) -> Array:
    """(3,) Unit vector from points to where most of the cameras stand; z if they stand all around."""
    rays = viewpoints - points.mean(axis=0)
    lengths = np.linalg.norm(rays, axis=1, keepdims=True)
    side = (rays / np.maximum(lengths, 1e-300)).sum(axis=0)
    length = float(np.linalg.norm(side))
    return np.asarray(side / length) if length > 1e-6 else np.array([0.0, 0.0, 1.0])
