"""Pixels of a view's image that stand above the table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.images.above_table import MIN_SEEN, smooth_where_seen
from strand.reconstruction.images.table_plane import Plane, find_table
from strand.support.checks import Array
from strand.support.robust import robust_deviation
from strand.views.depth_image import DepthImage
from strand.views.rope_images import rope_images
from strand.views.view import View

_MAX_POINTS = 30_000  # points that the table is sought in
_SMOOTHING = 0.8  # pixels: standard deviation of the Gaussian that smooths heights
_DEVIATIONS = 5.0  # standard deviations of the table's heights: what is higher stands above it
_MIN_HEIGHT = 0.001  # of the table's distance: what stands above it is higher
_TABLE_HEIGHT = 0.005  # of the table's distance: what is this near the table belongs to it
_MAX_HEIGHT = 0.03  # of the table's distance: larger heights are cut before they are smoothed
_MIN_BLOB = 25  # pixels: smaller blobs are noise
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
    """

    image: DepthImage
    plane: Plane
    above: Array


def find_tabletop(image: DepthImage) -> Tabletop | None:
    """Find the table in all depth of an image, and what stands above it; None if there is no table."""
    seen = image.depth > 0
    rows, columns = np.nonzero(seen)
    step = max(len(rows) // _MAX_POINTS, 1)
    rows, columns = rows[::step], columns[::step]
    camera = image.pose[:3, 3]
    found = find_table(image.lift(rows, columns, image.depth[rows, columns]) - camera)
    if found is None:
        return None
    plane = Plane(found.normal, found.offset + float(found.normal @ camera))
    v, u = np.mgrid[: image.depth.shape[0], : image.depth.shape[1]]
    above = np.where(seen, plane.measure_heights(image.lift(v, u, image.depth)), 0.0)
    return Tabletop(image.masked(_segment_standing(above, seen, -found.offset)), plane, above)


def holds_table(views: Sequence[View], within: Sequence[View]) -> bool:
    """Tell whether an extraction range holds a table.

    It does if most of the pixels that one view shows in it belong to a table.

    Parameters
    ----------
    views : sequence of View
        Without masks.
    within : sequence of View
        The same views, cropped to the extraction range.
    """
    most = max(range(len(views)), key=lambda k: len(within[k].points))
    view, own = views[most], within[most]
    size = _USUAL_PIXELS if view.image is None else view.image.depth.size
    # a quick look first
    if len(own.points) < _MIN_SHARE_IN_RANGE * size:
        return False
    if find_table(own.points[:: max(len(own.points) // _MAX_POINTS, 1)]) is None:
        return False
    (image,) = rope_images([own], [view], None)
    top = find_tabletop(image)
    if top is None:
        return False
    return bool(2 * np.count_nonzero(image.mask & top.image.mask) < np.count_nonzero(image.mask))


def _segment_standing(above: Array, seen: NDArray[np.bool_], distance: float) -> NDArray[np.bool_]:
    """Return the pixels (H, W) whose smoothed height stands out from a table at a distance, metres."""
    # relative to the distance, as single precision does not hold metres in every unit
    cut = np.clip(above / distance, -_MAX_HEIGHT, _MAX_HEIGHT)
    smooth, shares = smooth_where_seen(cut, seen, _SMOOTHING)
    scatter = robust_deviation(smooth[seen & (np.abs(smooth) < _TABLE_HEIGHT)])
    found = (shares > MIN_SEEN) & (smooth > max(_DEVIATIONS * scatter, _MIN_HEIGHT))
    numbers = _core.blob_numbers(found)
    return np.asarray(found & (np.bincount(numbers.ravel())[numbers] >= _MIN_BLOB))
