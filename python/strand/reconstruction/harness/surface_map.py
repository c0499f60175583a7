"""A map of ropes seen from above: where they are, how wide, and how high their upper surface lies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand._core import NotEnoughDataError
from strand.support.checks import Array

_CELL = 0.3  # side of a cell, least radii
_MIN_CELL = 0.35e-3  # metres
_CELL_OF_STEP = 0.8  # side of a cell at most, distances between neighbouring points
_SMOOTHING = 0.75  # standard deviation of the density's smoothing, distances between neighbouring points
_MARGIN = 6.0  # of the map around the ropes, greatest radii
_MAX_CELLS = 16_000_000  # of a map: more are no ropes
_OCCUPIED = 0.38  # density of a rope at least, its upper quartile
_WELL_SEEN = 0.3  # density at which heights count, the same
_AROUND = 6.0  # deviation of the stretch around a cell that tells how dense ropes are, greatest radii
_COARSE = 0.5  # side of the blocks of cells that are taken together for it, greatest radii
_FLOOR = 0.3  # density at which the table is seen, its median
_MIN_FLOOR = 1e-6  # points in a cell where the table counts as seen at all
_MIN_SHARE = 0.3  # of the points in a cell are of a rope, where noise lifts points of the table
_CLOSED = 1.8  # half width of the shadows that are closed, greatest radii
_MAX_SPECK = 10.0  # area of pieces that are dropped, squared least radii
_MAX_HOLE = 1.7  # area of holes that are filled, the same
_EDGE = 0.35  # standard deviation of the smoothing of edges, least radii
_SPREAD = 1.0  # standard deviation with which heights spread to cells that are hardly seen, greatest radii
_ACROSS = np.linspace(-0.8, 0.8, 17)  # half widths: places across a strand, of which some lie on wires' backs
_BACK = 85.0  # percentile of the heights across a strand that is the height of the wires' backs
_MIN_DENSITY = 1e-20  # that sums of heights are divided by at least


@dataclass(frozen=True, eq=False)
class SurfaceMap:
    """Ropes seen from above, on a grid.

    Attributes
    ----------
    frame : (3, 3) ndarray
        Columns: the map's first and second axis, across the way of looking, and up, in the world frame.
    corner : (2,) ndarray
        Place of the corner of cell (0, 0), metres.
    cell : float
        Side of a cell, metres.
    mask : (H, W) ndarray of bool
        The ropes' cells.
    heights : (H, W) ndarray
        Height of the upper surface, metres; where it is hardly seen, the mean height around.
    half_widths : (H, W) ndarray
        Distance from the edge of the mask, cells.
    seen : (H, W) ndarray of bool
        Cells of the mask with points of ropes; the others lie in shadows.
    """

    frame: Array
    corner: Array
    cell: float
    mask: NDArray[np.bool_]
    heights: Array
    half_widths: Array
    seen: NDArray[np.bool_]

    @property
    def ridge(self) -> float:
        """Height of the surface of a tube over its axis as the map shows it, radii."""
        return float(np.cross(self.frame[:, 0], self.frame[:, 1]) @ self.frame[:, 2])

    def sample_heights(self, places: Array) -> Array:
        """Return heights (M,) at places (M, 2) in cells, metres."""
        return self.heights[self._index(places)]

    def sample_widths(self, places: Array) -> Array:
        """Return half widths (M,) at places (M, 2) in cells, cells."""
        return self.half_widths[self._index(places)]

    def sample_backs(self, places: Array, half: float) -> tuple[Array, Array]:
        """Return places (M, K, 2) across a line of places (M, 2), and the height (M,) of backs there, metres.

        `half` is the half width of the line's strand, cells.
        """
        around = places[:, None] + (_ACROSS * half)[:, None] * find_normals(places)[:, None]
        heights = self.sample_heights(around.reshape(-1, 2)).reshape(len(places), -1)
        return around, np.percentile(heights, _BACK, axis=1)

    def share_seen(self, places: Array) -> float:
        """Return the share of places (M, 2) in cells at which points of ropes were seen."""
        return float(self.seen[self._index(places)].mean())

    def cover(self, points: Array) -> NDArray[np.bool_]:
        """Tell which points (N, 3), metres, lie on the mask in the plan."""
        return self.hold(self.flatten(points)[0])

    def hold(self, places: Array) -> NDArray[np.bool_]:
        """Tell which places (M, 2) in cells lie on a rope."""
        return self.mask[self._index(places)]

    def flatten(self, points: Array) -> tuple[Array, Array]:
        """Return places (M, 2) in cells and heights (M,) of points (M, 3) of the world, metres."""
        seen = points @ self.frame
        return (seen[:, :2] - self.corner) / self.cell - 0.5, seen[:, 2]

    def holds(self, place: Array) -> bool:
        """Tell whether a place (2,) in cells lies on a rope."""
        return bool(self.hold(place[None])[0])

    def lift(self, places: Array, heights: Array) -> Array:
        """Return places (M, 2) in cells with heights (M,) in the world frame, (M, 3) metres."""
        plan = (places + 0.5) * self.cell + self.corner
        return np.asarray(np.column_stack([plan, heights]) @ np.linalg.inv(self.frame))

    def _index(self, places: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        rounded = np.rint(places).astype(np.int64)
        rows, columns = (np.clip(rounded[:, axis], 0, self.mask.shape[axis] - 1) for axis in (0, 1))
        return rows, columns


def find_normals(places: Array) -> Array:
    """Return unit vectors (M, 2) across a line of places (M, 2)."""
    across = np.gradient(places, axis=0)[:, ::-1] * (1.0, -1.0)
    return np.asarray(across / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12))


def make_frame(up: Array) -> Array:
    """Return a rotation (3, 3) whose third column is a unit vector."""
    across = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(up, across), up])


def make_map(
    clouds: Sequence[Array],
    viewpoints: Array,
    floor: Array,
    up: Array,
    toward: Array,
    radii: tuple[float, float],
    middle: int,
) -> SurfaceMap:
    """Draw ropes as they are seen from one side.

    Parameters
    ----------
    clouds : sequence of (N, 3) ndarray
        The ropes' points of each view, metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres, metres.
    floor : (M, 3) ndarray
        Points of the table; none if there is none.
    up : (3,) ndarray
        Unit vector along which heights are measured.
    toward : (3,) ndarray
        Unit vector against which the map looks.
    radii : (float, float)
        The least and the greatest radius of the ropes, metres.
    middle : int
        The view whose points tell how dense neighbouring points are.
    """
    least, greatest = radii
    frame = np.column_stack([make_frame(toward)[:, :2], up])
    step = _measure_step(clouds[middle], least)
    cell = min(max(_CELL * least, _MIN_CELL), _CELL_OF_STEP * step)
    points = np.concatenate(clouds) @ frame
    corner = points[:, :2].min(axis=0) - _MARGIN * greatest
    extent = points[:, :2].max(axis=0) + _MARGIN * greatest - corner
    if extent.prod() > _MAX_CELLS * cell**2:
        cell = float(np.sqrt(extent.prod() / _MAX_CELLS))
    height, width = np.ceil(extent / cell).astype(int).tolist()
    shape = (height, width)
    # a pixel far away stands for more surface
    squares = np.concatenate(
        [
            np.einsum("ij,ij->i", cloud - center, cloud - center)
            for cloud, center in zip(clouds, viewpoints, strict=True)
        ]
    )
    rows, columns = np.floor((points[:, :2] - corner) / cell).astype(np.int64).T
    density, sums = _add_up(
        rows * shape[1] + columns, points[:, 2], squares / np.median(squares), shape, greatest
    )
    kernel = _make_kernel(_SMOOTHING * step / cell)
    density, sums = _core.convolved(density, kernel), _core.convolved(sums, kernel)
    table = _count_floor(floor @ frame, corner, cell, shape, kernel)
    counted = _core.convolved(
        np.bincount(rows * shape[1] + columns, minlength=shape[0] * shape[1])
        .reshape(shape)
        .astype(np.float32),
        kernel,
    )
    density[counted < _MIN_SHARE * (counted + table)] = 0.0
    typical = float(np.percentile(density[density > 0.0], 75.0)) if (density > 0.0).any() else 0.0
    if typical <= 0.0:
        raise NotEnoughDataError("views: no points of a rope in the extraction range")
    dense = np.minimum(typical, _measure_around(density, greatest / cell)) if len(clouds) > 1 else typical
    mask = density > _OCCUPIED * dense
    area = (least / cell) ** 2
    mask = _drop_specks(mask, 0.5 * _MAX_SPECK * area)
    mask = ~_drop_specks(~mask, _MAX_HOLE * area)
    if len(floor):
        mask = _close_shadows(mask, table, _CLOSED * greatest / cell)
    mask = _drop_specks(mask, _MAX_SPECK * area)
    mask = _core.convolved(mask.astype(np.float32), _make_kernel(_EDGE * least / cell)) > 0.5
    if not mask.any():
        raise NotEnoughDataError("views: the ropes' points are too few, or lie too far apart, to draw a map")
    well_seen = density >= _WELL_SEEN * dense
    around = _make_kernel(_SPREAD * greatest / cell)
    spread = [
        _core.convolved(np.where(well_seen, values, 0.0).astype(np.float32), around)
        for values in (sums, density)
    ]
    sums, density = (
        np.where(well_seen, own, wide) for own, wide in zip((sums, density), spread, strict=True)
    )
    heights = sums.astype(np.float64) / np.maximum(density, _MIN_DENSITY)
    half_widths = _core.measure_edge_distances(mask, sum(shape)).astype(np.float64)
    return SurfaceMap(frame, corner, float(cell), mask, heights, half_widths, well_seen)


def _measure_step(points: Array, radius: float) -> float:
    """Return the distance of neighbouring points, metres, by their number within a radius."""
    return radius * float(np.sqrt(np.pi / max(_core.count_typical_neighbors(points, radius), 1)))


def _add_up(
    cells: NDArray[np.int64], heights: Array, weights: Array, shape: tuple[int, int], reach: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the density of points and the sum of heights of those near the top, in each cell."""
    count = shape[0] * shape[1]
    top = np.full(count, -np.inf)
    np.maximum.at(top, cells, heights)
    top = _raise_to_neighbors(top.reshape(shape)).ravel()
    near = heights > top[cells] - reach
    density = np.bincount(cells[near], weights[near], count)
    sums = np.bincount(cells[near], weights[near] * heights[near], count)
    return density.reshape(shape).astype(np.float32), sums.reshape(shape).astype(np.float32)


def _measure_around(density: NDArray[np.float32], radius: float) -> NDArray[np.float32]:
    """Return how dense ropes are around each cell: fewer views see some places; `radius` is in cells."""
    step = max(int(radius * _COARSE), 1)
    rows, columns = (-(-size // step) for size in density.shape)
    padded = np.zeros((rows * step, columns * step), dtype=np.float32)
    padded[: density.shape[0], : density.shape[1]] = density
    blocks = padded.reshape(rows, step, columns, step)
    kernel = _make_kernel(_AROUND * radius / step)
    # weighted by itself, so that the ropes' middles count
    sums, squares = (
        _core.convolved(np.ascontiguousarray(values.sum(axis=(1, 3))), kernel)
        for values in (blocks, blocks**2)
    )
    around = squares / np.maximum(sums, np.float32(_MIN_DENSITY))
    fine = np.repeat(np.repeat(around, step, axis=0), step, axis=1).astype(np.float32)
    return fine[: density.shape[0], : density.shape[1]]


def _raise_to_neighbors(values: Array) -> Array:
    """Return the greatest value of each cell and its eight neighbours."""
    padded = np.pad(values, 1, constant_values=-np.inf)
    rows = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    return np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])


def _make_kernel(deviation: float) -> list[float]:
    """Return a Gaussian from its middle on; its sum over both sides is 1."""
    reach = max(int(np.ceil(4.0 * deviation)), 1)
    values = np.exp(-0.5 * (np.arange(reach + 1) / max(deviation, 1e-3)) ** 2)
    return [float(value) for value in values / (2.0 * values.sum() - values[0])]


def _drop_specks(mask: NDArray[np.bool_], least: float) -> NDArray[np.bool_]:
    """Return a mask without its pieces of fewer cells."""
    numbers = _core.number_blobs(np.ascontiguousarray(mask))
    sizes = np.bincount(numbers.ravel())
    sizes[0] = 0
    return sizes[numbers] > least


def _count_floor(
    floor: Array, corner: Array, cell: float, shape: tuple[int, int], kernel: list[float]
) -> NDArray[np.float32]:
    """Return the density of the table's points in each cell."""
    rows, columns = np.floor((floor[:, :2] - corner) / cell).astype(np.int64).T
    inside = (rows >= 0) & (columns >= 0) & (rows < shape[0]) & (columns < shape[1])
    seen = np.bincount(rows[inside] * shape[1] + columns[inside], minlength=shape[0] * shape[1])
    return _core.convolved(seen.reshape(shape).astype(np.float32), kernel)


def _close_shadows(mask: NDArray[np.bool_], table: NDArray[np.float32], width: float) -> NDArray[np.bool_]:
    """Close gaps of a mask where neither rope nor table was seen: there a higher strand hides both."""
    if not (table > _MIN_FLOOR).any():
        return mask
    free = table > _FLOOR * np.median(table[table > _MIN_FLOOR])
    most = int(width) + 2
    wide = _core.measure_edge_distances(~mask, most) <= width
    closed = _core.measure_edge_distances(np.ascontiguousarray(wide), most) > width
    return np.ascontiguousarray(mask | (closed & ~free))
