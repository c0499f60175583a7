"""The ropes' radius as masks show it, for views whose depth is too wide to tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.reconstruction.images.prepare import prepare_images
from strand.reconstruction.images.table_plane import Plane, find_table_beside_ropes
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

# a rope's top is seen this much lower above its table than it is: matchers and mixed pixels pull it down
_SEEN_HEIGHT = 0.85
# of the estimate: masks are a pixel too wide or too narrow, and depth is pulled
_SD = 0.15
# rounds until the width by which a mask is read is the one that it shows, and when that is so
_ROUNDS, _SAME = 3, 0.05


def shown_radius(images: Sequence[DepthImage]) -> tuple[Array, Array]:
    """Estimate the radius of ropes in masks.

    A mask's area over twice the length of the ropes in it is their radius in the image. Where they lie on a
    table, half of their height above it is another estimate; the mean of both is taken.

    Parameters
    ----------
    images : sequence of DepthImage

    Returns
    -------
    radius, sd : (1,) ndarray
        Metres.

    Raises
    ------
    strand.NotEnoughDataError
        If the middle view's mask shows no rope with depth.
    """
    middle = len(images) // 2
    image = images[middle]
    across = _core.shown_radius(image.mask)
    if across is None or np.isnan(image.distance):
        raise NotEnoughDataError("views: the masks show no rope with depth")
    scale = image.distance / image.camera.focal[0]
    radius = across * scale
    chains: list[Array] = []
    for _ in range(_ROUNDS):
        chains = [
            nodes
            for _, _, chains, _ in prepare_images([image], radius).readings(None, 1, [0])
            for nodes in chains
        ]
        if not chains:
            break
        length = sum(float(np.linalg.norm(np.diff(nodes, axis=0), axis=1).sum()) for nodes in chains)
        before, radius = radius, np.count_nonzero(image.mask) / (2.0 * length) * scale
        if abs(radius / before - 1.0) < _SAME:
            break
    table = find_table_beside_ropes(image, radius)
    if table is not None and chains:
        height = _height(image, np.vstack(chains), table)
        radius = 0.5 * (radius + min(max(0.5 * height / _SEEN_HEIGHT, 0.5 * radius), 1.5 * radius))
    return np.array([radius]), np.array([_SD * radius])


def _height(image: DepthImage, axis: Array, table: Plane) -> float:
    """How high above the table the pixels along a rope's axis in the image are, in the median, metres."""
    columns, rows = np.rint(axis).astype(np.int64).T
    height, width = image.depth.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    columns, rows = columns[inside], rows[inside]
    z = image.depth[rows, columns]
    seen = z > 0
    world = image.lift(rows[seen], columns[seen], z[seen])
    return float(np.median(table.heights(world))) if len(world) else 0.0
