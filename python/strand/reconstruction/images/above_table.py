"""Ropes told from their table in noisy depth: where a smoothed height stands out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.images.pixel_errors import neighbours_alike
from strand.reconstruction.images.rope_image import RopeImage, rope_images
from strand.reconstruction.images.table_plane import table_plane
from strand.reconstruction.stages import Observed
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.view import View, cropped, masked

LOWEST = -2.0
"""Single heights count only above this, radii."""

# and only below this; the smoothing's standard deviation, and where a rope's edge is: at half of its mean
# height; radii
_HIGHEST, _SMOOTH, _EDGE = 4.0, 0.45, 0.85
# share of the smoothed pixels that must have depth
_SEEN = 0.3
# radius of the widest rope that is told from its table, as part of the image's longer side
_WIDEST = 0.25
# a view without a mask of whose points this share lies on the table, lower than so many radii, shows more
# than ropes; ropes are looked for so many radii around those that masks show
_ON_TABLE, _LOW, _AROUND = 0.3, 0.5, 4.0
# from this on errors of neighbouring pixels are so much alike that they look like ropes
_ALIKE = 0.5


def without_untold(observed: Observed) -> Observed:
    """Leave out views without a mask that do not tell ropes from their table, if others have masks.

    Where errors of neighbouring pixels are alike, much stands out of a table that is no rope. Depth images
    without a mask tell nothing then, and points that show the table neither.

    Parameters
    ----------
    observed : Observed

    Returns
    -------
    Observed
        The same if all are kept.
    """
    shown = _shown_beside_masks(observed)
    if shown is None:
        return observed
    given, radius, images, table = shown
    if neighbours_alike(images) < _ALIKE:
        return observed
    kept = [
        k
        for k, view in enumerate(observed.whole)
        if given[k] or not (view.image or (table and _on_table(observed.views[k], table, radius)))
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


def all_masked(observed: Observed) -> Observed:
    """Give views without a mask one of what stands out of the table near the ropes in other views' masks.

    Views that show little of the table stay as they are, and all of them where there is no table.

    Parameters
    ----------
    observed : Observed

    Returns
    -------
    Observed
    """
    shown = _shown_beside_masks(observed)
    if shown is None:
        return observed
    given, radius, images, table = shown
    if table is None:
        return observed
    ropes = np.vstack([view.world_points for view, own in zip(observed.views, given, strict=True) if own])
    bounds = observed.bounds
    low, high = np.percentile(ropes if bounds is None else bounds.coordinates(ropes), (1, 99), axis=0)
    near = Box(low - _AROUND * radius, high + _AROUND * radius)
    if bounds is not None:
        near = Box(np.maximum(near.low, bounds.low), np.minimum(near.high, bounds.high), bounds.pose)
    views, whole = list(observed.views), list(observed.whole)
    for number, (own, view) in enumerate(zip(observed.views, observed.whole, strict=True)):
        if view.image is None or given[number] or not _on_table(own, table, radius):
            continue
        cut = masked(view, standing_out(images[number], table, near, radius))
        (inside,) = cropped([cut], near)
        if len(inside.points):
            views[number], whole[number] = inside, cut
    return replace(observed, views=tuple(views), whole=tuple(whole))


def _shown_beside_masks(
    observed: Observed,
) -> tuple[list[bool], float, list[RopeImage], tuple[Array, float] | None] | None:
    """Return which views have a mask, the ropes' radius, what all images show, and the table.

    None if all views have a mask, or none. The table is that of the middle one of those that have.
    """
    given = observed.masked
    if all(given) or not any(given):
        return None
    radius = float(observed.radii.values[0])
    images = rope_images(observed.views, observed.whole, observed.bounds, 2.0 * radius)
    with_masks = np.flatnonzero(given)
    return given, radius, images, table_plane(images, int(with_masks[len(with_masks) // 2]), radius)


def _on_table(view: View, table: tuple[Array, float], radius: float) -> bool:
    """Tell whether a view shows more than ropes: much that lies on the table."""
    normal, offset = table
    return float(np.mean(view.world_points @ normal - offset < _LOW * radius)) >= _ON_TABLE


def raised(
    images: Sequence[RopeImage], table: tuple[Array, float] | None, bounds: Box | None, radius: float
) -> list[RopeImage]:
    """Return images with masks of what stands out from a table.

    Parameters
    ----------
    images : sequence of RopeImage
    table : ((3,) ndarray, float) or None
        Its unit normal n and n.x, metres; without one the images stay as they are.
    bounds : Box or None
        The extraction range, metres.
    radius : float
        Metres.

    Returns
    -------
    list of RopeImage
        One in which nothing stands out stays as it is.
    """
    if table is None:
        return list(images)
    found = []
    for image in images:
        mask = standing_out(image, table, bounds, radius)
        found.append(replace(image, mask=mask) if mask.any() else image)
    return found


def standing_out(
    image: RopeImage, table: tuple[Array, float], bounds: Box | None, radius: float
) -> np.ndarray:
    """Return the pixels (H, W) where a smoothed height above a table is a rope's of this radius, metres."""
    above, seen, across = heights(image, table, bounds, radius)
    if not seen.any() or across > _WIDEST * max(image.mask.shape):
        return np.zeros_like(image.mask)
    kernel = gaussian(max(_SMOOTH * across, 0.6))
    counted = np.where(seen, np.clip(above, LOWEST * radius, _HIGHEST * radius), 0.0)
    shares = _core.convolved(seen.astype(np.float32), kernel)
    smooth = _core.convolved(counted.astype(np.float32), kernel) / np.maximum(shares, 1e-9)
    return np.asarray((smooth > _EDGE * radius) & (shares > _SEEN))


def heights(
    image: RopeImage, table: tuple[Array, float], bounds: Box | None, radius: float
) -> tuple[Array, NDArray[np.bool_], float]:
    """Return how far above a table each pixel shows something.

    Parameters
    ----------
    image : RopeImage
    table : ((3,) ndarray, float)
        Its unit normal n and n.x, metres.
    bounds : Box or None
        The extraction range, metres.
    radius : float
        Metres.

    Returns
    -------
    (H, W) ndarray, (H, W) ndarray of bool, float
        Heights, metres; which pixels have depth and would be in the extraction range if they were a rope's;
        the rope's radius at their median depth, pixels, 0 if there are none.
    """
    normal, offset = table
    height, width = image.depth.shape
    z = image.depth
    seen = z > 0
    rows, columns = np.mgrid[:height, :width]
    world = image.world(rows, columns, z)
    above = world @ normal - offset
    if bounds is not None:
        # where a rope's axis would be, whatever the noise says
        axis = world + (radius - above)[..., None] * normal
        seen &= bounds.holds(axis, radius)
    across = radius * image.focal[0] / float(np.median(z[seen])) if seen.any() else 0.0
    return above, seen, across


def gaussian(deviation: float) -> list[float]:
    """Return a Gaussian's weights from its middle on."""
    reach = int(np.ceil(3.0 * deviation))
    kernel = np.exp(-0.5 * (np.arange(reach + 1) / deviation) ** 2)
    return [float(weight) for weight in kernel / (kernel[0] + 2.0 * kernel[1:].sum())]
