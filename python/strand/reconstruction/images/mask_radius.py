"""The ropes' radius by masks, for views whose depth is too noisy to show it."""

from __future__ import annotations

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.geometry.plane import Plane
from strand.reconstruction.images.fat_masks import slim_fat_masks
from strand.reconstruction.images.finer_grid import magnify_thin_ropes
from strand.reconstruction.images.mask_parts import count_mask_parts, explain_many_parts
from strand.reconstruction.images.table_plane import find_table_beside_ropes
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_SEEN_HEIGHT = 0.88  # of a rope's height above its table: matchers and mixed pixels pull it down
_SD = 0.15  # of the radius: masks are a pixel too wide or too narrow, and depth is pulled
_MIN_SHARE = 0.5  # of the radius by another measure: the least radius that counts
_MAX_SHARE = 1.5  # of the same: the largest
_MAX_BY_AREA = 2.0  # of the radius by a mask's widths, which raggedness makes smaller: the largest
_MIN_WIDER = 0.25  # pixels: masks that are wider on each side than ropes are high by less are not slimmed
_MIN_CUT = 0.02  # of a mask: with less cut away it shows the same radius
_ROUNDS = 2  # measurements of the mask, each by the radius that was known before
_SAME = 0.1  # relative change of the radius: with less it has settled
_OVER_WIDTHS = 1.12  # radius by area over the one by widths, about


def estimate_mask_radius(image: DepthImage) -> tuple[Array, Array]:
    """Return the radius of ropes in a mask and its standard deviation, (1,) metres each.

    The area of single strands in a mask over twice their length is their radius in the image. On a table,
    half of their height is another estimate, and the mean of both is returned. A mask that is wider than what
    stands out of the table is slimmed to that before.

    Raises
    ------
    strand.NotEnoughDataError
        If the mask shows no rope with depth.
    """
    radius, chains = estimate_radius_by_area(image)
    table = find_table_beside_ropes(image, radius)
    if table is not None and chains:
        by_height = 0.5 * _measure_height(image, np.vstack(chains), table) / _SEEN_HEIGHT
        least = max(by_height, _MIN_SHARE * radius)
        pixels = (radius - least) * image.camera.focal[0] / image.distance
        if pixels > _MIN_WIDER:
            (slim,) = slim_fat_masks([image], table, None, _SEEN_HEIGHT * least)
            if len(slim.mask_pixels) < (1.0 - _MIN_CUT) * len(image.mask_pixels):
                radius, _ = estimate_radius_by_area(slim)
        radius = 0.5 * (radius + min(max(by_height, _MIN_SHARE * radius), _MAX_SHARE * radius))
    return np.array([radius]), np.array([_SD * radius])


def estimate_radius_by_area(image: DepthImage) -> tuple[float, list[Array]]:
    """Return the radius by a mask's area, metres, and the strands that it was measured along, pixels.

    Raises
    ------
    strand.NotEnoughDataError
        If the mask shows no rope with depth.
    """
    pixels = image.mask_radius
    if pixels is None or np.isnan(image.distance):
        raise NotEnoughDataError("views: the masks show no rope with depth")
    if reason := explain_many_parts(count_mask_parts(image.mask, pixels)):
        raise NotEnoughDataError(f"views: no radius is given, and the view to measure it has {reason}")
    shown = pixels * image.distance / image.camera.focal[0]
    radius, chains = _measure_area(image, shown)
    # ragged masks show a radius that is too small, but not that of thin ropes once they are read
    (fine,), factor = magnify_thin_ropes([image], radius)
    if factor > 1:
        radius, places = _measure_area(fine, shown)
        chains = [image.camera.convert(nodes, fine.camera) for nodes in places]
    return radius, chains


def _measure_area(image: DepthImage, shown: float) -> tuple[float, list[Array]]:
    """Return the radius by area, metres, and the single strands. `shown` is the radius by the widths."""
    scale = image.distance / image.camera.focal[0]
    radius = shown
    roughly = _OVER_WIDTHS * shown
    chains: list[Array] = []
    for _ in range(_ROUNDS):
        found = image.rope_mask.measure_strands(roughly / scale)
        if found is None:
            break
        by_area, chains = found
        radius = float(np.clip(by_area * scale, _MIN_SHARE * shown, _MAX_BY_AREA * shown))
        if abs(radius / roughly - 1.0) < _SAME:
            break
        roughly = radius
    return radius, chains


def _measure_height(image: DepthImage, axis: Array, table: Plane) -> float:
    """Return the median height above the table of the pixels along a rope's axis in the image, metres."""
    columns, rows = np.rint(axis).astype(np.int64).T
    height, width = image.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    columns, rows = columns[inside], rows[inside]
    z = image.depth[rows, columns]
    seen = z > 0
    world = image.lift(rows[seen], columns[seen], z[seen])
    return _core.find_median(table.measure_heights(world)) if len(world) else 0.0
