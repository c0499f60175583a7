"""Depth images in which the ropes' pixels are marked, made of points where a view has no image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array
from strand.views.box import Box
from strand.views.cloud_images import draw_cloud, draw_ropes
from strand.views.depth_image import DepthImage
from strand.views.view import View


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
        draw_ropes(view, uncropped)[0]
        if uncropped.image is None
        else _mark_rope_pixels(uncropped.image, view, bounds, margin)
        for view, uncropped in zip(views, whole, strict=True)
    ]


def make_image(view: View) -> DepthImage:
    """Return a view's depth image, or one made of its points."""
    return draw_cloud(view) if view.image is None else view.image


def _mark_rope_pixels(image: DepthImage, view: View, bounds: Box | None, margin: float) -> DepthImage:
    if image.labels is None:
        mask = np.zeros(image.depth.shape, dtype=bool)
        mask[find_pixels(view.points, image)] = True
        return replace(image, labels=mask)
    mask = image.mask
    if bounds is None:
        return image if mask is image.labels else replace(image, labels=mask)
    rows, columns = image.list_seen()
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
