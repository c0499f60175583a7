"""What stands above the table in each view's image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.reconstruction.finding.plane import in_plane, largest_plane
from strand.reconstruction.images.above_table import gaussian
from strand.reconstruction.images.rope_image import RopeImage
from strand.support.checks import Array
from strand.support.robust import robust_deviation

# points that the table is sought in, at most; the share of a view's points that a table has
_POINTS, _SHARE = 30_000, 0.3
# the side of its cells, of its distance, how many of them have points all around, and which share of all
_CELL, _CELLS, _INNER = 0.04, 30, 0.3
# heights are smoothed by so many pixels; what stands out by so many deviations of what lies on the table, and
# by this share of its distance, stands above it
_SMOOTH, _DEVIATIONS, _LOWEST = 0.8, 5.0, 0.001
# heights above this share of the distance are cut before they are smoothed
_HIGHEST = 0.03
# squares of coordinates are finite up to here, metres
_FARTHEST = 1e75
# blobs of fewer pixels are noise; the share of the smoothed pixels that must have depth
_FEWEST, _SEEN = 25, 0.3


@dataclass(frozen=True, eq=False)
class Tabletop:
    """One view's image with the table that it sees.

    Attributes
    ----------
    image : RopeImage
        Its mask is what stands above the table, whatever its height.
    normal : (3,) ndarray
        The table's unit normal towards the camera, world frame.
    offset : float
        `normal @ x` of places x on the table, metres.
    above : (H, W) ndarray
        How high each pixel is above it, metres; 0 where there is no depth.
    """

    image: RopeImage
    normal: Array
    offset: float
    above: Array


def tabletop(image: RopeImage) -> Tabletop | None:
    """Find the table in an image, and what stands above it; None if there is no table.

    A table is a plane that most points lie on, side by side: points of ropes alone lie in strips.

    Parameters
    ----------
    image : RopeImage
        Its mask is not used.
    """
    seen = image.depth > 0
    rows, columns = np.nonzero(seen)
    step = max(len(rows) // _POINTS, 1)
    rows, columns = rows[::step], columns[::step]
    centre = image.pose[:3, 3]
    found = table_in(image.world(rows, columns, image.depth[rows, columns]) - centre)
    if found is None:
        return None
    normal, from_camera = found
    offset = from_camera + float(normal @ centre)
    v, u = np.mgrid[: image.depth.shape[0], : image.depth.shape[1]]
    above = np.where(seen, image.world(v, u, image.depth) @ normal - offset, 0.0)
    return Tabletop(replace(image, mask=_standing(above, seen, -from_camera)), normal, offset, above)


def table_in(points: Array) -> tuple[Array, float] | None:
    """Return the plane that most points lie on, if they lie side by side there, farther than ropes do.

    Parameters
    ----------
    points : (N, 3) ndarray
        From where the camera is, metres.

    Returns
    -------
    ((3,) ndarray, float) or None
        Its unit normal n towards the camera, and n.x, metres.
    """
    if not len(points) or np.abs(points).max() > _FARTHEST:
        return None
    found = largest_plane(points)
    if found is None or found[2] < _SHARE:
        return None
    normal, offset, _ = found
    on_plane = np.abs(points @ normal - offset) < _LOWEST * 5.0 * np.linalg.norm(points, axis=1)
    return (normal, offset) if _is_wide(points[on_plane], normal) else None


def _is_wide(points: Array, normal: Array) -> bool:
    """Whether points on a plane lie side by side, farther than ropes do."""
    plan = points @ in_plane(normal)
    side = _CELL * float(np.median(np.linalg.norm(points, axis=1)))
    cells = np.floor((plan - plan.min(axis=0)) / side).astype(np.int64)
    size = cells.max(axis=0) + 3
    if size.prod() > 1_000_000:
        return False
    taken = np.zeros(size, dtype=bool)
    taken[tuple((cells + 1).T)] = True
    inner = int(np.count_nonzero(_core.edge_distances(taken, 4) > 1.5))
    return inner >= _CELLS and inner >= _INNER * int(np.count_nonzero(taken))


def _standing(above: Array, seen: NDArray[np.bool_], distance: float) -> NDArray[np.bool_]:
    kernel = gaussian(_SMOOTH)
    # in distances, as single precision holds no number of metres
    cut = np.where(seen, np.clip(above / distance, -_HIGHEST, _HIGHEST), 0.0)
    shares = _core.convolved(seen.astype(np.float32), kernel)
    smooth = _core.convolved(cut.astype(np.float32), kernel) / np.maximum(shares, 1e-9)
    on_table = smooth[seen & (np.abs(smooth) < _LOWEST * 5.0)]
    scatter = robust_deviation(on_table)
    found = (shares > _SEEN) & (smooth > max(_DEVIATIONS * scatter, _LOWEST))
    numbers = _core.blob_numbers(found)
    return np.asarray(found & (np.bincount(numbers.ravel())[numbers] >= _FEWEST))
