"""What each view's image shows of the ropes: depth and mask, made of points where there is no image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.support.checks import Array
from strand.support.lazy import lazy_property
from strand.views.box import Box
from strand.views.pose import moved
from strand.views.view import DepthImage, View

# pixels around the points of an image that is made of points
_MARGIN = 8
# points should share their pixel with so few others that this part of them has one of its own
_APART = 0.75
# an image that is made of points has at most so many pixels a side
_LARGEST = 1500


@dataclass(frozen=True, eq=False)
class RopeImage:
    """One view as an image of ropes.

    Attributes
    ----------
    depth : (H, W) ndarray
        Metres; 0 where there is no return.
    mask : (H, W) ndarray of bool
        The ropes' pixels.
    focal, centre : (float, float)
        Pixels.
    pose : (4, 4) ndarray
        Camera to world.
    """

    depth: Array
    mask: NDArray[np.bool_]
    focal: tuple[float, float]
    centre: tuple[float, float]
    pose: Array

    @lazy_property
    def distance(self) -> float:
        """The median depth of the ropes' pixels, metres; NaN if none has depth."""
        depths = self.depth[self.mask]
        depths = depths[depths > 0]
        return float(np.median(depths)) if len(depths) else float("nan")

    def projected(self, points: Array) -> Array:
        """(M, 2) Columns and rows of points of the world, pixels."""
        x, y, z = ((points - self.pose[:3, 3]) @ self.pose[:3, :3]).T
        (fx, fy), (cx, cy) = self.focal, self.centre
        return np.column_stack([fx * x / z + cx, fy * y / z + cy])

    def world(self, rows: NDArray[np.int64], columns: NDArray[np.int64], z: Array) -> Array:
        """(..., 3) Points of the world that pixels would show at depths z, metres."""
        (fx, fy), (cx, cy) = self.focal, self.centre
        return moved(np.stack([(columns - cx) * z / fx, (rows - cy) * z / fy, z], axis=-1), self.pose)


def rope_images(
    views: Sequence[View], whole: Sequence[View], bounds: Box | None, margin: float = 0.0
) -> list[RopeImage]:
    """Return each view's image of the ropes.

    Parameters
    ----------
    views : sequence of View
        Cropped and without outliers.
    whole : sequence of View
        The same views with all that they saw.
    bounds : Box or None
        The extraction range, metres.
    margin : float
        How far out of the extraction range a pixel of a mask may be, metres: where depth is noisy, ropes are
        seen a little out of it.

    Returns
    -------
    list of RopeImage
        Where there is a mask, the rope's pixels are those inside it, but for those whose depth is out of the
        extraction range; elsewhere those of the points.
    """
    return [
        _of_points(view)
        if all_seen.image is None
        else _of_image(view, all_seen, all_seen.image, bounds, margin)
        for view, all_seen in zip(views, whole, strict=True)
    ]


def _of_image(view: View, whole: View, image: DepthImage, bounds: Box | None, margin: float) -> RopeImage:
    if image.mask is None:
        mask = np.zeros(image.depth.shape, dtype=bool)
        mask[pixels_of(view.points, image)] = True
        return RopeImage(image.depth, mask, image.focal, image.centre, whole.pose)
    seen = RopeImage(image.depth, image.mask != 0, image.focal, image.centre, whole.pose)
    if bounds is None:
        return seen
    rows, columns = np.nonzero(seen.mask & (seen.depth > 0))
    world = seen.world(rows, columns, seen.depth[rows, columns])
    out = ~bounds.holds(world, margin)
    mask = seen.mask.copy()
    mask[rows[out], columns[out]] = False
    return replace(seen, mask=mask)


def pixels_of(points: Array, image: DepthImage) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of an image's own points, camera frame."""
    x, y, z = points.T
    (fx, fy), (cx, cy) = image.focal, image.centre
    height, width = image.depth.shape
    # of depths that are nearly nothing rounding leaves no pixel
    rows, columns = np.clip(y / z * fy + cy, 0, height - 1), np.clip(x / z * fx + cx, 0, width - 1)
    return np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)


def _of_points(view: View) -> RopeImage:
    """Project points to an image whose pixels are as far apart as they are."""
    points = view.points
    towards = points.mean(axis=0)
    forward = towards / np.linalg.norm(towards)
    aside = np.cross(np.eye(3)[np.abs(forward).argmin()], forward)
    aside /= np.linalg.norm(aside)
    frame = np.column_stack([aside, np.cross(forward, aside), forward])
    x, y, z = (points @ frame).T
    ahead = z > 0
    if not ahead.any():
        raise NotEnoughDataError(
            "views: the points are too far from their camera to be told apart, in metres"
        )
    slopes = np.column_stack([x[ahead] / z[ahead], y[ahead] / z[ahead]])
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    focal = _focal(slopes - low, float((high - low).max()))
    columns, rows = np.rint((slopes - low) * focal).astype(np.int64).T + _MARGIN
    depth = np.zeros((rows.max() + _MARGIN + 1, columns.max() + _MARGIN + 1))
    # the nearest point is what a camera would see
    order = np.argsort(-z[ahead], kind="stable")
    depth[rows[order], columns[order]] = z[ahead][order]
    pose = view.pose.copy()
    pose[:3, :3] = view.pose[:3, :3] @ frame
    centre = (float(_MARGIN - low[0] * focal), float(_MARGIN - low[1] * focal))
    return RopeImage(depth, depth > 0, (focal, focal), centre, pose)


def _focal(slopes: Array, extent: float) -> float:
    """Return the focal length at which most points have a pixel of their own, pixels."""
    low, high = 1.0 / max(extent, 1e-9), _LARGEST / max(extent, 1e-9)
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        columns, rows = np.rint(slopes * middle).astype(np.int64).T
        taken = np.zeros((rows.max() + 1, columns.max() + 1), dtype=bool)
        taken[rows, columns] = True
        if np.count_nonzero(taken) < _APART * len(slopes):
            low = middle
        else:
            high = middle
    return low


def prepared(images: Sequence[RopeImage], radius: float) -> _core.RopeImages:
    """Prepare images for readings and fits of ropes of one radius, metres.

    Raises
    ------
    ValueError
        If a mask shows no rope with depth.
    """
    return _core.RopeImages(
        [image.depth for image in images],
        [image.mask for image in images],
        [(image.focal, image.centre) for image in images],
        [image.pose for image in images],
        radius,
    )
