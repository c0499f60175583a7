"""Ropes segmented from their table in noisy depth: smoothed heights that stand out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.pixel_errors import CONFUSING_CORRELATION, correlate_neighbors
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.reconstruction.stages import Observed
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.view import View, cropped, masked

MIN_HEIGHT = -2.0  # radii: lower heights of single pixels are cut off
MAX_HEIGHT = 4.0  # radii: higher heights of single pixels are cut off
_SMOOTHING = 0.45  # radii: standard deviation of the Gaussian that smooths heights
_MIN_SMOOTHING = 0.6  # pixels
_EDGE_HEIGHT = 0.85  # radii: half of a rope's mean smoothed height, which is where its edge is
_MIN_SEEN = 0.3  # of the weight of smoothed pixels has depth
_MAX_RADIUS = 0.25  # of the image's longer side: wider ropes are not segmented
_LOW = 0.5  # radii: lower points lie on the table
_MIN_TABLE_SHARE = 0.3  # of a view's points lie on the table if it shows more than ropes
_AROUND = 4.0  # radii around the ropes that masks show: other views' ropes are sought there

Heights = tuple[Array, NDArray[np.bool_], float]  # heights of pixels, as `measure_heights` returns them


def drop_unclear_views(observed: Observed) -> Observed:
    """Drop views without a mask in which errors hide the ropes, if others have masks.

    Where errors of neighbouring pixels are correlated, parts of the table stand out as ropes do. Then depth
    images without a mask do not show which pixels are ropes, nor do points that include the table.
    """
    shown = _see_beside_masks(observed)
    if shown is None:
        return observed
    given, radius, images, table = shown
    if correlate_neighbors(images) < CONFUSING_CORRELATION:
        return observed
    kept = [
        k
        for k, view in enumerate(observed.whole)
        if given[k] or not (view.image or (table and _shows_table(observed.views[k], table, radius)))
    ]
    if len(kept) == len(given):
        return observed
    return replace(
        observed,
        views=[observed.views[k] for k in kept],
        whole=[observed.whole[k] for k in kept],
        numbers=[observed.numbers[k] for k in kept],
        middle=observed.numbers[observed.held],
    )


def add_masks(observed: Observed) -> Observed:
    """Give views without a mask one of what stands out of the table near the ropes in other views' masks.

    Views that show little of the table stay as they are. Without a table, all views do.
    """
    shown = _see_beside_masks(observed)
    if shown is None:
        return observed
    given, radius, images, table = shown
    if table is None:
        return observed
    ropes = np.vstack([view.world_points for view, own in zip(observed.views, given, strict=True) if own])
    bounds = observed.bounds
    low, high = np.percentile(ropes if bounds is None else bounds.express(ropes), (1, 99), axis=0)
    near = Box(low - _AROUND * radius, high + _AROUND * radius)
    if bounds is not None:
        near = Box(np.maximum(near.low, bounds.low), np.minimum(near.high, bounds.high), bounds.pose)
    views, whole = list(observed.views), list(observed.whole)
    for number, (own, view) in enumerate(zip(observed.views, observed.whole, strict=True)):
        if view.image is None or given[number] or not _shows_table(own, table, radius):
            continue
        mask = segment_above_table(images[number], table, near, radius)
        cut = masked(view, replace(view.image, labels=mask))
        (inside,) = cropped([cut], near)
        if len(inside.points):
            views[number], whole[number] = inside, cut
    return replace(observed, views=tuple(views), whole=tuple(whole))


def _see_beside_masks(observed: Observed) -> tuple[list[bool], float, list[DepthImage], Plane | None] | None:
    """Return which views have a mask, the ropes' radius, all images, and the table in the middle mask's view.

    None if all views have a mask, or none.
    """
    given = observed.masked
    if all(given) or not any(given):
        return None
    radius = float(observed.radii.values[0])
    images = observed.images
    with_masks = np.flatnonzero(given)
    middle = images[int(with_masks[len(with_masks) // 2])]
    return given, radius, images, find_table_beside_ropes(middle, radius)


def _shows_table(view: View, table: Plane, radius: float) -> bool:
    """Tell whether many points of a view lie on a table."""
    return float(np.mean(table.measure_heights(view.world_points) < _LOW * radius)) >= _MIN_TABLE_SHARE


def mask_above_table(
    images: Sequence[DepthImage], table: Plane | None, bounds: Box | None, radius: float
) -> list[DepthImage]:
    """Return images with masks of what stands out from a table, as `segment_above_table` finds it.

    Images in which nothing stands out stay as they are. Without a table, all images do.
    """
    if table is None:
        return list(images)
    found = []
    for image in images:
        mask = segment_above_table(image, table, bounds, radius)
        found.append(replace(image, labels=mask) if mask.any() else image)
    return found


def segment_above_table(
    image: DepthImage, table: Plane, bounds: Box | None, radius: float
) -> NDArray[np.bool_]:
    """(H, W) Return the pixels in bounds whose smoothed height is that of a rope of a radius, metres."""
    return select_standing(measure_heights(image, table, bounds, radius), radius)


def select_standing(heights: Heights, radius: float) -> NDArray[np.bool_]:
    """(H, W) Return the same, given the heights."""
    above, seen, pixels = heights
    if pixels == 0.0 or pixels > _MAX_RADIUS * max(above.shape):
        return np.zeros(above.shape, dtype=bool)
    kernel = make_gaussian_kernel(max(_SMOOTHING * pixels, _MIN_SMOOTHING))
    limits = (MIN_HEIGHT * radius, MAX_HEIGHT * radius)
    return _core.find_standing(above, seen, limits, kernel, _EDGE_HEIGHT * radius, _MIN_SEEN)


def measure_heights(image: DepthImage, table: Plane, bounds: Box | None, radius: float) -> Heights:
    """Return how far above a table each pixel shows something.

    Parameters
    ----------
    image : DepthImage
    table : Plane
    bounds : Box or None
        The extraction range, metres.
    radius : float
        Metres.

    Returns
    -------
    above : (H, W) ndarray
        Heights, metres.
    seen : (H, W) ndarray of bool
        Pixels with depth that would be in the extraction range if they were a rope's.
    pixels : float
        The radius at the median depth of these, pixels; 0 if there are none.
    """
    within = None
    if bounds is not None:
        # where a rope's axis would be, whatever the noise
        grown = bounds.grown(radius)
        within = (grown.low, grown.high, np.eye(4) if grown.pose is None else grown.pose)
    above, seen, distance = _core.measure_heights(
        image.depth, image.camera, image.pose, table, within, radius
    )
    pixels = 0.0 if distance is None else radius * image.camera.focal[0] / distance
    return above, seen, pixels


def make_gaussian_kernel(deviation: float) -> list[float]:
    """Return a Gaussian's weights from its middle on, by its standard deviation in pixels."""
    reach = int(np.ceil(3.0 * deviation))
    kernel = np.exp(-0.5 * (np.arange(reach + 1) / deviation) ** 2)
    return [float(weight) for weight in kernel / (kernel[0] + 2.0 * kernel[1:].sum())]
