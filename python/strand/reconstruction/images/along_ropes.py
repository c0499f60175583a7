"""Depths that scatter, averaged along the ropes: the noise that is left is narrower than a rope."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.plane import Plane
from strand.reconstruction.images.above_table import MIN_HEIGHT, make_gaussian_kernel, measure_heights
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.depth_image import DepthImage, list_pixels

# standard deviations of Gaussians
_ALONG = 1.5  # radii: of means along the rope
_ACROSS = 0.35  # radii: of means across it
_SLOPE = 0.6  # radii: of heights before their slopes
_COURSE = 1.0  # radii: of squared slopes
_MIN_SMOOTHING = 0.5  # pixels: of all
_MAX_HEIGHT = 8.0  # radii: larger heights of single pixels are cut; ropes may lie on ropes


def average_along_ropes(image: DepthImage, table: Plane, bounds: Box | None, radius: float) -> Array:
    """(N, 3) Return a mask's pixels as points, camera frame, metres, whose heights are means along the rope.

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
    """
    above, seen, pixels = measure_heights(image, table, bounds, radius)
    counted = np.where(seen, np.clip(above, MIN_HEIGHT * radius, _MAX_HEIGHT * radius) / radius, 0.0)
    own = seen & image.mask
    if not own.any():
        return np.empty((0, 3))
    rows, columns = list_pixels(own)

    def smooth(values: Array | NDArray[np.bool_], deviation: float) -> Array:
        kernel = make_gaussian_kernel(max(deviation * pixels, _MIN_SMOOTHING))
        return np.asarray(_core.convolved(values.astype(np.float32), kernel), float)

    down, aside = np.gradient(smooth(counted, _SLOPE) / np.maximum(smooth(seen, _SLOPE), 1e-6))
    squares = [smooth(np.asarray(each), _COURSE)[rows, columns] for each in (aside**2, down**2, aside * down)]
    angle = 0.5 * np.arctan2(2.0 * squares[2], squares[0] - squares[1]) + 0.5 * np.pi
    sums, weights = smooth(np.where(own, counted, 0.0), _ACROSS), smooth(own, _ACROSS)
    deviation = (_ALONG**2 - _ACROSS**2) ** 0.5 * pixels
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
    rays = image.camera.cast_rays(rows, columns)
    slope = rays @ image.pose[:3, :3].T @ normal
    z = (offset + height - image.pose[:3, 3] @ normal) / np.where(slope < 0.0, slope, -np.inf)
    return np.asarray(rays[z > 0.0] * z[z > 0.0, None])
