"""Depth images in which the ropes' pixels are marked, made of points where a view has no image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strand._core import NotEnoughDataError
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole
from strand.views.view import View

_MARGIN = 8  # pixels around the points of an image that is made of points
_MIN_OWN_PIXELS = 0.75  # share of the points that should have a pixel of their own
_MAX_SIZE = 1500  # largest side of an image that is made of points, pixels


def make_rope_images(
    views: Sequence[View], whole: Sequence[View], bounds: Box | None, margin: float = 0.0
) -> list[DepthImage]:
    """Return each view's depth image with a mask of its ropes.

    With a mask, the ropes' pixels are those inside it, except for pixels whose depth lies outside the
    extraction range. Without a mask, they are the pixels of the view's points.

    Parameters
    ----------
    views : sequence of View
        Cropped and without outliers.
    whole : sequence of View
        The same views, uncropped.
    bounds : Box or None
        The extraction range, metres.
    margin : float
        How far outside the extraction range a pixel of a mask may lie, metres: noise moves depths of ropes a
        little out of it.
    """
    return [
        _draw_points(view)
        if uncropped.image is None
        else _mark_rope_pixels(uncropped.image, view, bounds, margin)
        for view, uncropped in zip(views, whole, strict=True)
    ]


def make_image(view: View) -> DepthImage:
    """Return a view's depth image, or one made of its points."""
    return _draw_points(view) if view.image is None else view.image


def _mark_rope_pixels(image: DepthImage, view: View, bounds: Box | None, margin: float) -> DepthImage:
    if image.labels is None:
        mask = np.zeros(image.depth.shape, dtype=bool)
        mask[find_pixels(view.points, image)] = True
        return replace(image, labels=mask)
    mask = image.mask
    if bounds is None:
        return replace(image, labels=mask)
    rows, columns = np.nonzero(mask & (image.depth > 0))
    outside = ~bounds.holds(image.lift(rows, columns, image.depth[rows, columns]), margin)
    mask = mask.copy()
    mask[rows[outside], columns[outside]] = False
    return replace(image, labels=mask)


def find_pixels(points: Array, image: DepthImage) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the rows and the columns of an image's own points, camera frame."""
    height, width = image.depth.shape
    columns, rows = image.camera.project(points).T
    # rounding moves points at the smallest depths out of the image
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    return np.rint(rows).astype(np.int64), np.rint(columns).astype(np.int64)


def _draw_points(view: View) -> DepthImage:
    """Project points to an image with about one pixel for each point."""
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
            "views: the points are too far from their camera to be distinguished; are they in metres?"
        )
    slopes = np.column_stack([x[ahead] / z[ahead], y[ahead] / z[ahead]])
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    focal = _fit_focal_length(slopes - low, float((high - low).max()))
    columns, rows = np.rint((slopes - low) * focal).astype(np.int64).T + _MARGIN
    depth = np.zeros((rows.max() + _MARGIN + 1, columns.max() + _MARGIN + 1))
    # the nearest point is what a camera would see
    order = np.argsort(-z[ahead], kind="stable")
    depth[rows[order], columns[order]] = z[ahead][order]
    pose = view.pose.copy()
    pose[:3, :3] = view.pose[:3, :3] @ frame
    center = (float(_MARGIN - low[0] * focal), float(_MARGIN - low[1] * focal))
    return DepthImage(depth, Pinhole((focal, focal), center), pose, depth > 0)


def _fit_focal_length(slopes: Array, extent: float) -> float:
    """Return the focal length at which most points have a pixel of their own, pixels."""
    low, high = 1.0 / max(extent, 1e-9), _MAX_SIZE / max(extent, 1e-9)
    for _ in range(12):
        middle = float(np.sqrt(low * high))
        columns, rows = np.rint(slopes * middle).astype(np.int64).T
        taken = np.zeros((rows.max() + 1, columns.max() + 1), dtype=bool)
        taken[rows, columns] = True
        if np.count_nonzero(taken) < _MIN_OWN_PIXELS * len(slopes):
            low = middle
        else:
            high = middle
    return low
