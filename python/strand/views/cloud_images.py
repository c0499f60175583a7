"""Depth images made of clouds: in the pixels they were measured in, or in pixels as dense as their points."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole
from strand.views.pixel_grid import PixelGrid, aim_camera, find_pixel_grid
from strand.views.view import View

_MARGIN = 8  # pixels around the points of an image
_MIN_OWN_PIXELS = 0.75  # share of the points that should have a pixel of their own, without a grid
_MAX_SIZE = 1500  # largest side of an image without a grid, pixels
_AROUND = 0.3  # of the extent of ropes: the surroundings that are drawn too
_MOSTLY_ROPES = 0.8  # share of the points around ropes: with more in the ropes a cloud shows ropes alone
_CLOSING = 1.0  # pixels: radius of the disc that closes holes of a mask without many
_MIN_DENSITY = 0.2  # share of pixels with depth beside others with depth: sparser masks are not closed more
_FILLINGS = 3  # times that gaps are filled at most
_MAX_THINNED = 0.9  # share of pixels with depth between others with depth: fuller images have no gaps to fill
_MIN_BESIDE = 5.0  # of the eight pixels beside a gap have depth, over that share; beside an edge fewer have


def draw_cloud(view: View) -> DepthImage:
    """Return an image of a cloud in which the pixels with depth are marked."""
    return _draw(view, view.points, find_pixel_grid(view.points))


def draw_ropes(ropes: View, whole: View) -> tuple[DepthImage, bool]:
    """Return an image of a cloud with a mask of ropes, and whether its pixels are those of a camera.

    Holes between points are closed if the cloud shows little but ropes; else nothing but points is marked.

    Parameters
    ----------
    ropes : View
        Points of the ropes, some of those of the whole cloud.
    whole : View
    """
    points, grid = ropes.points, find_pixel_grid(ropes.points)
    around = _select_around(whole.points, points)
    alone = len(points) > _MOSTLY_ROPES * len(around)
    image = _draw(ropes, points if alone else around, grid)
    mask = find_mask(ropes, image)
    return replace(image, labels=close_holes(mask) if alone else mask), grid is not None


def find_mask(view: View, image: DepthImage) -> NDArray[np.bool_]:
    """(H, W) Return the pixels of an image that show points of a view."""
    height, width = image.depth.shape
    columns, rows = np.rint(image.project(view.world_points)).astype(np.int64).T
    mask = np.zeros((height, width), dtype=bool)
    mask[rows.clip(0, height - 1), columns.clip(0, width - 1)] = True
    return mask


def close_holes(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(H, W) Return a mask closed by a disc that is wider the sparser its pixels are."""
    reach = _CLOSING / math.sqrt(max(_measure_density(mask), _MIN_DENSITY))
    most = math.ceil(reach) + 2
    wide = _core.measure_edge_distances(~mask, most) <= reach
    return np.asarray(mask | (_core.measure_edge_distances(wide, most) > reach))


def fill_thinned(image: DepthImage) -> DepthImage:
    """Return an image in which pixels between those with depth have the median depth of the ones beside them.

    Clouds with fewer points than pixels, picked at random, have such gaps. Other images stay as they are.
    """
    depth = image.depth
    for _ in range(_FILLINGS):
        density = _measure_fullness(depth > 0)
        if density > _MAX_THINNED:
            break
        depth = _fill_gaps(depth, density)
    return image if depth is image.depth else replace(image, depth=depth)


def _fill_gaps(depth: Array, density: float) -> Array:
    """(H, W) Return depths with gaps filled where enough of the eight pixels beside a gap have depth."""
    padded = np.pad(depth, 1)
    rows, columns = np.nonzero(depth == 0)
    places = [(row, column) for row in range(3) for column in range(3) if (row, column) != (1, 1)]
    beside = np.stack([padded[rows + row, columns + column] for row, column in places])
    counts = np.count_nonzero(beside, axis=0)
    inside = counts >= max(_MIN_BESIDE * density, 2.0)
    beside, counts = np.sort(beside[:, inside], axis=0), counts[inside]
    filled = depth.copy()
    # zeros come first, and the median is one of the depths
    filled[rows[inside], columns[inside]] = beside[len(places) - 1 - counts // 2, np.arange(len(counts))]
    return filled


def _measure_fullness(mask: NDArray[np.bool_]) -> float:
    """Return the share of the pixels between two of a mask, beside or below each other, that are in it."""
    between = [(mask[:, :-2] & mask[:, 2:], mask[:, 1:-1]), (mask[:-2] & mask[2:], mask[1:-1])]
    full = sum(int(np.count_nonzero(around & inner)) for around, inner in between)
    return full / max(sum(int(np.count_nonzero(around)) for around, _ in between), 1)


def _measure_density(mask: NDArray[np.bool_]) -> float:
    """Return the share of the pixels right of and below those of a mask that are in it too."""
    beside = int(np.count_nonzero(mask[1:] & mask[:-1]) + np.count_nonzero(mask[:, 1:] & mask[:, :-1]))
    return beside / (2.0 * max(int(np.count_nonzero(mask)), 1))


def _select_around(points: Array, ropes: Array) -> Array:
    """Return the points (N, 3) that are seen near ropes (M, 3)."""
    frame = aim_camera(ropes)
    x, y, z = (ropes @ frame).T
    z = np.maximum(z, 1e-12)
    slopes = np.column_stack([x / z, y / z])
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    margin = _AROUND * float((high - low).max())
    x, y, z = (points @ frame).T
    ahead = np.maximum(z, 1e-12)
    inside = (z > 0) & (x / ahead > low[0] - margin) & (x / ahead < high[0] + margin)
    inside &= (y / ahead > low[1] - margin) & (y / ahead < high[1] + margin)
    return np.asarray(points[inside])


def _draw(view: View, points: Array, grid: PixelGrid | None) -> DepthImage:
    """Return an image of points (N, 3) of a view's frame, with about one pixel for each point."""
    turn = aim_camera(points) if grid is None else grid.turn
    x, y, z = (points @ turn).T
    ahead = z > 0
    if not ahead.any():
        raise NotEnoughDataError(
            "views: the points are too far from their camera to be distinguished; are they in metres?"
        )
    x, y, z = x[ahead], y[ahead], z[ahead]
    slopes = np.column_stack([x / z, y / z])
    low, high = slopes.min(axis=0), slopes.max(axis=0)
    if grid is None:
        focal = _fit_focal_length(slopes - low, float((high - low).max()))
        camera = Pinhole((focal, focal), (float(_MARGIN - low[0] * focal), float(_MARGIN - low[1] * focal)))
    else:
        focals, centers = np.array(grid.camera.focal), np.array(grid.camera.center)
        first = np.rint(low * focals + centers) - _MARGIN
        camera = grid.camera.magnified(1, (float(first[0]), float(first[1])))
    pixels = slopes * np.array(camera.focal) + np.array(camera.center)
    columns, rows = np.rint(pixels).astype(np.int64).T
    depth = np.zeros((rows.max() + _MARGIN + 1, columns.max() + _MARGIN + 1))
    # the nearest point is what a camera would see
    order = np.argsort(-z, kind="stable")
    depth[rows[order], columns[order]] = z[order]
    pose = view.pose.copy()
    pose[:3, :3] = view.pose[:3, :3] @ turn
    return DepthImage(depth, camera, pose, depth > 0)


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
