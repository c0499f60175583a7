"""Pixels of a view's image that stand above the table."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.color_masks.near_table import select_seen
from strand.reconstruction.images.table_plane import find_table
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.cloud_images import fill_thinned
from strand.views.depth_image import DepthImage, list_pixels
from strand.views.extract import Extract

_MAX_POINTS = 10_000  # points that the table is sought in
_MIN_SHARE_IN_RANGE = 0.04  # of an image's pixels, in the extraction range: with fewer it holds no table
_USUAL_PIXELS = 200_000  # pixels of an image, where a view has points alone


@dataclass(frozen=True, eq=False)
class Tabletop:
    """A view's image with the table that it shows.

    Attributes
    ----------
    image : DepthImage
        Its mask is what stands above the table.
    plane : Plane
        The table in the world frame.
    above : (H, W) ndarray
        How far each pixel is above the table, metres; 0 where there is no depth.
    inside : (H, W) ndarray of bool
        Which pixels show points in the extraction range.
    """

    image: DepthImage
    plane: Plane
    above: Array
    inside: NDArray[np.bool_]


def find_tabletop(image: DepthImage, bounds: Box | None) -> Tabletop | None:
    """Find the table in all depth of an image, and what stands above it; None if there is no table."""
    rows, columns = select_seen(image.depth, _MAX_POINTS)
    camera = image.pose[:3, 3]
    found = find_table(image.lift(rows, columns, image.depth[rows, columns]) - camera)
    if found is None:
        return None
    plane = Plane(found.normal, found.offset + float(found.normal @ camera))
    above, standing = _core.find_tabletop(image.depth, image.camera, image.pose, plane, -found.offset)
    return Tabletop(replace(image, labels=standing), plane, above, _select_inside(image, bounds))


def holds_table(extract: Extract) -> bool:
    """Tell whether the extraction range of views without masks holds a table.

    It does if most of the pixels that one view shows in it belong to a table.
    """
    most = max(range(len(extract.inside)), key=lambda k: len(extract.inside[k].points))
    view, own = extract.whole[most], extract.inside[most]
    size = _USUAL_PIXELS if view.image is None else view.image.depth.size
    # a quick look first
    if len(own.points) < _MIN_SHARE_IN_RANGE * size:
        return False
    if find_table(own.points[:: max(len(own.points) // _MAX_POINTS, 1)]) is None:
        return False
    image = extract.images[most]
    if image is not None and view.image is None:
        image = fill_thinned(image)
    top = None if image is None else find_tabletop(image, None)
    if image is None or top is None:
        return False
    return bool(2 * np.count_nonzero(image.mask & top.image.mask) < np.count_nonzero(image.mask))


def _select_inside(image: DepthImage, bounds: Box | None) -> NDArray[np.bool_]:
    """Return which pixels (H, W) show points in an extraction range; all without one."""
    if bounds is None:
        return np.ones(image.depth.shape, dtype=bool)
    rows, columns = list_pixels(image.depth > 0)
    found = np.zeros(image.depth.shape, dtype=bool)
    found[rows, columns] = bounds.holds(image.lift(rows, columns, image.depth[rows, columns]))
    return found
