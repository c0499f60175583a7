"""The table: whether there is one, and which plane it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.lengths import measure_lengths
from strand.geometry.plane import Plane
from strand.reconstruction.stages import SoughtTable
from strand.support.checks import Array
from strand.views.depth_image import DepthImage

_SEED = 0  # of the draws of three points that planes are tried through

# a plane among all points
_MAX_POINTS_COMPARED = 3000  # points that planes are compared with
_PLANES = 300  # planes that are tried
_MIN_SINE = 1e-6  # between edges of three points: with less they lie on a line
_FIRST_WIDTH = 0.01  # of the median distance: points this near a plane lie on it at first
_MIN_WIDTH = 0.002  # of the median distance: points this near a plane always lie on it
_DEVIATIONS = 3.0  # standard deviations of the points about the plane: farther ones do not lie on it
_ROUNDS = 4  # fits by least squares

# a table among all points
_MIN_TABLE_SHARE = 0.3  # of the points lie on a table
_TABLE_WIDTH = 0.005  # of a point's distance: points this near the table lie on it
_MAX_COORDINATE = 1e75  # metres: squares of larger ones are infinite
_CELL = 0.04  # of the median distance: side of the cells that points on a table are counted in
_MAX_CELLS = 1_000_000  # cells of a grid: with more the points are no table's
_MIN_INNER_CELLS = 30  # cells with points in all neighbours
_MIN_INNER_SHARE = 0.3  # of the cells have points in all neighbours

# a table beside ropes
_POINTS_BESIDE = 1500  # points beside the ropes, about
_PLANES_BESIDE = 150  # planes that are tried
_MIN_AREA = 1e-12  # square metres: points that span less lie on a line
_EACH_BESIDE = 3  # every third point is compared with the planes
_MIN_SHARE_BESIDE = 0.5  # of the points lie on the table
_MIN_POINTS_BESIDE = 100  # points on the table
_WIDTH_BESIDE = 1.0  # radii: points this near the table lie on it
_ROUNDS_BESIDE = 3  # fits by least squares
_MARGIN = 4  # pixels around the ropes that may show them too
_REACH = 40.0  # radii around the ropes in which the table is sought
_HALF_WINDOWS = (
    8,
    32,
)  # pixels: half sides of squares whose mean depths show a table that single ones do not


def find_table(points: Array) -> Plane | None:
    """Return the table in (N, 3) points around their camera, metres; None if there is none.

    A table is the plane that most points lie on, if these are spread wider than points of ropes alone.
    """
    if not len(points) or np.abs(points).max() > _MAX_COORDINATE:
        return None
    away = measure_lengths(points)
    found = find_largest_plane(points, away)
    if found is None or found[1] < _MIN_TABLE_SHARE:
        return None
    plane, _ = found
    on_plane = np.abs(plane.measure_heights(points)) < _TABLE_WIDTH * away
    is_wide = _is_wide(np.compress(on_plane, points, axis=0), away[on_plane], plane)
    return plane if is_wide else None


def find_largest_plane(points: Array, away: Array | None = None) -> tuple[Plane, float] | None:
    """Find the plane that most of some points lie on, by RANSAC and least squares.

    Parameters
    ----------
    points : (N, 3) ndarray
        In the frame of the camera that saw them, metres.
    away : (N,) ndarray, optional
        Their distances from it, if they are known.

    Returns
    -------
    (Plane, float) or None
        The plane and the share of the points that lie on it; None if three points do not fix one.
    """
    if len(points) < 3:
        return None
    width = _FIRST_WIDTH * _core.find_median(measure_lengths(points) if away is None else away)
    count = min(_MAX_POINTS_COMPARED, len(points))
    numbers = np.random.default_rng(_SEED).integers(0, len(points), count + 3 * _PLANES)
    drawn = points.take(numbers, axis=0)
    compared, corners = drawn[:count], drawn[count:]
    adaptive = (_DEVIATIONS, _MIN_WIDTH / _FIRST_WIDTH * width)
    found = _core.find_plane(points, compared, corners, width, (0.0, _MIN_SINE), 0.0, _ROUNDS, 3, adaptive)
    if found is None:
        return None
    normal, offset, share = found
    return (Plane(normal, offset) if offset < 0.0 else Plane(-normal, -offset)), share


def find_table_beside_ropes(image: DepthImage, radius: float) -> Plane | None:
    """Return the table that ropes of a radius, metres, lie on, world frame; None if the image shows none.

    It is the plane that most points beside the mask lie on, to within a rope's radius. If single depths
    scatter too widely for that, it is the plane of means of depths.
    """
    reach = _measure_reach(image, radius)
    table = _find_plane_beside(_select_beside(image, reach, image.depth), image, radius)
    for half in _HALF_WINDOWS:
        if table is not None:
            break
        means = _average_beside(image, half)
        table = _find_plane_beside(_select_beside(image, reach, means), image, radius)
    return table


def recall_table(image: DepthImage, radius: float, sought: SoughtTable | None) -> Plane | None:
    """Return what `find_table_beside_ropes` does, without a search if the same table was sought before."""
    if sought is not None and sought.holds_for(image, radius):
        return sought.table
    return find_table_beside_ropes(image, radius)


def _find_plane_beside(points: Array, image: DepthImage, radius: float) -> Plane | None:
    """Return the plane that most of (N, 3) points lie on, to within a radius, metres; None without one."""
    if len(points) < _MIN_POINTS_BESIDE:
        return None
    numbers = np.random.default_rng(_SEED).integers(0, len(points), 3 * _PLANES_BESIDE)
    corners = points.take(numbers, axis=0)
    found = _core.find_plane(
        points,
        points[::_EACH_BESIDE],
        corners,
        _WIDTH_BESIDE * radius,
        (_MIN_AREA, 0.0),
        _MIN_SHARE_BESIDE,
        _ROUNDS_BESIDE,
        _MIN_POINTS_BESIDE,
        None,
    )
    if found is None:
        return None
    normal, offset, _ = found
    return Plane(normal, offset) if normal @ image.pose[:3, 3] > offset else Plane(-normal, -offset)


def _is_wide(points: Array, away: Array, plane: Plane) -> bool:
    """Tell whether points on a plane, so far away, lie side by side, wider than ropes do."""
    plan = plane.axes.T @ points.T
    side = _CELL * _core.find_median(away)
    cells = np.floor((plan - plan.min(axis=1, keepdims=True)) / side).astype(np.int64) + 1
    size = cells.max(axis=1) + 2
    if size.prod() > _MAX_CELLS:
        return False
    taken: NDArray[np.bool_] = np.zeros(size, dtype=bool)
    taken[tuple(cells)] = True
    inner = int(np.count_nonzero(_core.measure_edge_distances(taken, 4) > 1.5))
    return inner >= _MIN_INNER_CELLS and inner >= _MIN_INNER_SHARE * int(np.count_nonzero(taken))


def _average_beside(image: DepthImage, half: int) -> Array:
    """(H, W) Return the mean depth of pixels beside the ropes, in squares around each pixel, metres.

    A square reaches `half` pixels to each side. The mean is 0 where less than half of it has depth.
    """
    beside = (image.depth > 0) & (_add_squares(image.mask, _MARGIN) == 0.0)
    counts = _add_squares(beside, half)
    sums = _add_squares(np.where(beside, image.depth, 0.0), half)
    return np.where(2.0 * counts > (2 * half + 1) ** 2, sums / np.maximum(counts, 1.0), 0.0)


def _add_squares(values: Array | NDArray[np.bool_], half: int) -> Array:
    """(H, W) Return sums over squares around each pixel that reach `half` pixels to each side."""
    side = 2 * half + 1
    padded = np.pad(values.astype(np.float64), ((half + 1, half), (half + 1, half)))
    sums = padded.cumsum(axis=0).cumsum(axis=1)
    return np.asarray(sums[side:, side:] - sums[side:, :-side] - sums[:-side, side:] + sums[:-side, :-side])


def _measure_reach(image: DepthImage, radius: float) -> int:
    """Return how far around ropes of a radius, metres, their table is sought, pixels."""
    far = _core.find_median(image.mask_depths)
    if far <= 0:
        return _MARGIN
    return int(min(_REACH * radius * image.camera.focal[0] / max(far, 1e-9), sum(image.mask.shape)))


def _select_beside(image: DepthImage, reach: int, depth: Array) -> Array:
    """(N, 3) Return points, world frame, of pixels around the ropes but not next to them.

    Their depths are given, (H, W) metres.
    """
    return image.lift(*_core.select_beside(image.mask, depth, reach, _MARGIN, _POINTS_BESIDE))
