"""Depths that scatter, averaged along the ropes: what is left of the noise is narrower than a rope."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.images.above_table import MIN_HEIGHT, make_gaussian_kernel, measure_heights
from strand.reconstruction.images.table_plane import Plane
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage

# standard deviations of the means, along a rope and across, and of what tells where it runs: of heights and
# of their slopes; radii
_ALONG, _ACROSS, _SLOPE, _COURSE = 1.5, 0.35, 0.6, 1.0
# kernels are at least so wide, pixels
_FINEST = 0.5
# single heights are cut off here, radii: ropes may lie on ropes
_HIGHEST = 8.0


def points_along(image: DepthImage, table: Plane, bounds: Box | None, radius: float) -> Array:
    """Return a mask's pixels as points, whose heights are means along the rope.

    A rope runs where heights change least: across the strongest direction of the structure tensor (Förstner
    and Gülch, *A fast operator for detection and precise location of distinct points, corners and centres of
    circular features*).

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
    (N, 3) ndarray
        In the camera's frame, metres.
    """
    above, seen, across = measure_heights(image, table, bounds, radius)
    counted = np.where(seen, np.clip(above, MIN_HEIGHT * radius, _HIGHEST * radius) / radius, 0.0)
    own = seen & image.mask
    if not own.any():
        return np.empty((0, 3))
    rows, columns = np.nonzero(own)

    def mean(values: Array | NDArray[np.bool_], deviation: float) -> Array:
        return np.asarray(
            _core.convolved(
                values.astype(np.float32), make_gaussian_kernel(max(deviation * across, _FINEST))
            ),
            float,
        )

    smooth = mean(counted, _SLOPE) / np.maximum(mean(seen, _SLOPE), 1e-6)
    down, aside = np.gradient(smooth)
    squares = [mean(np.asarray(each), _COURSE)[rows, columns] for each in (aside**2, down**2, aside * down)]
    angle = 0.5 * np.arctan2(2.0 * squares[2], squares[0] - squares[1]) + 0.5 * np.pi
    sums, weights = mean(np.where(own, counted, 0.0), _ACROSS), mean(own, _ACROSS)
    deviation = (_ALONG**2 - _ACROSS**2) ** 0.5 * across
    reach = int(np.ceil(3.0 * deviation))
    total, weight = np.zeros(len(rows)), np.zeros(len(rows))
    for step in range(-reach, reach + 1):
        v = np.clip(np.rint(rows + step * np.sin(angle)).astype(np.int64), 0, own.shape[0] - 1)
        u = np.clip(np.rint(columns + step * np.cos(angle)).astype(np.int64), 0, own.shape[1] - 1)
        share = np.exp(-0.5 * (step / deviation) ** 2)
        total += share * sums[v, u]
        weight += share * weights[v, u]
    height = radius * total / weight
    normal, offset = table
    rays = image.camera.rays(rows, columns)
    steep = rays @ image.pose[:3, :3].T @ normal
    z = (offset + height - image.pose[:3, 3] @ normal) / np.where(steep < 0.0, steep, -np.inf)
    return np.asarray(rays[z > 0.0] * z[z > 0.0, None])
