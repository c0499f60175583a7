"""Find the grid of pixels that a cloud was measured in: its camera's pinhole and rotation."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from strand.support.checks import Array
from strand.views.pinhole import Pinhole

_WINDOW = 400  # points that show how pixels lie beside each other
_SAMPLE = 1000  # points that the whole grid is fitted to
_NEAR_STEPS = 2.5  # pixels: differences of points up to this long fix two steps of the grid
_MIN_SINE = 0.5  # of the angle between the two steps
_MAX_ERROR = 0.1  # pixels: root mean square distance of points from their pixels' centres, one axis
_MAX_LEVELED = 0.2  # of a turn's cosines: cameras turned less are tried without the turn
_MAX_SKEW = 0.02  # of the focal length: columns and rows of a camera are perpendicular
_MAX_ASPECT = 1.3  # a camera's focal lengths differ by a smaller factor
_MIN_OWN_PIXELS = 0.97  # share of the points that have a pixel of their own
_MIN_FILLED = 0.4  # share of the pixels beside a point that have a point too
_MAX_PIXELS = 10_000_000  # pixels of an image


class PixelGrid(NamedTuple):
    """A camera whose pixels the points of a cloud are.

    Attributes
    ----------
    camera : Pinhole
    turn : (3, 3) ndarray
        Right, down and forward of the camera in the cloud's frame, columns.
    """

    camera: Pinhole
    turn: Array


def find_pixel_grid(points: Array) -> PixelGrid | None:
    """Return the grid of pixels of points (N, 3), in any order, of a camera at the origin.

    The grid may be turned in any way, and points may be missing. None if points lie on no grid.
    """
    if len(points) < 50:
        return None
    frame = aim_camera(points)
    z = points @ frame[:, 2]
    if not (z > 0).all():
        return None
    slopes = (points @ frame[:, :2]) / z[:, None]
    fitted = _fit_grid(slopes)
    grid = None if fitted is None else _make_camera(fitted, points, frame)
    return grid if grid is not None and _is_filled(points, grid) else None


def aim_camera(points: Array) -> Array:
    """Return (3, 3) right, down and forward, columns, of a camera at the origin that looks at points."""
    towards = points.mean(axis=0)
    forward = towards / np.linalg.norm(towards)
    aside = np.cross(np.eye(3)[np.abs(forward).argmin()], forward)
    aside /= np.linalg.norm(aside)
    return np.column_stack([aside, np.cross(forward, aside), forward])


def _fit_grid(slopes: Array) -> Array | None:
    """Return the (3, 3) homography from slopes (N, 2) to columns and rows; None if they lie on no grid."""
    middle = slopes[len(slopes) // 2]
    distances = ((slopes - middle) ** 2).sum(axis=1)
    near = np.argpartition(distances, min(_WINDOW, len(slopes) - 1))[:_WINDOW]
    steps = _find_steps(slopes[near])
    if steps is None:
        return None
    some = np.unique(np.concatenate([near, np.arange(0, len(slopes), max(len(slopes) // _SAMPLE, 1))]))
    order = some[np.argsort(distances[some], kind="stable")]
    sorted_slopes, reaches = slopes[order], distances[order]
    homography = np.eye(3)
    homography[:2, :2] = np.linalg.inv(steps)
    homography[:2, 2] = -homography[:2, :2] @ middle
    reach = 9.0 * float(np.linalg.norm(steps, axis=0).max()) ** 2
    while True:
        count = int(np.searchsorted(reaches, reach, side="right"))
        taken = sorted_slopes[:count]
        if count >= 12:
            pixels = _apply(homography, taken)
            rounded = np.rint(pixels)
            if _is_off(pixels - rounded, 2.0):
                return None
            homography = _solve_homography(taken, rounded, homography)
            if _is_off(_apply(homography, taken) - rounded, 1.0):
                return None
        if count == len(order):
            return homography if count >= 12 else None
        reach *= 4.0


def _is_off(errors: Array, allowance: float) -> bool:
    """Tell whether errors (N, 2), pixels, are more than those of points on a grid."""
    return not bool((errors**2).mean(axis=0).max() < (allowance * _MAX_ERROR) ** 2)


def _find_steps(slopes: Array) -> Array | None:
    """Return two steps of a grid, columns, by differences between slopes (N, 2) near each other."""
    some = slopes[:: max(len(slopes) // 60, 1)]
    differences = (slopes[None] - some[:, None]).reshape(-1, 2)
    lengths = np.hypot(*differences.T)
    lengths[lengths < 1e-3 * np.median(lengths)] = math.inf
    first = differences[lengths.argmin()]
    short = lengths < 12.0 * np.linalg.norm(first)
    differences, lengths = differences[short], lengths[short]
    sines = np.abs(differences @ [-first[1], first[0]]) / (lengths * np.linalg.norm(first))
    if not (sines > _MIN_SINE).any():
        return None
    second = differences[np.where(sines > _MIN_SINE, lengths, math.inf).argmin()]
    steps = np.column_stack([first, second])
    near = lengths < _NEAR_STEPS * max(np.linalg.norm(first), np.linalg.norm(second))
    for _ in range(3):
        counts = np.rint(differences[near] @ np.linalg.inv(steps).T)
        found, *_ = np.linalg.lstsq(counts, differences[near], rcond=None)
        steps = found.T
        if abs(np.linalg.det(steps)) < 1e-30:
            return None
    errors = differences[near] @ np.linalg.inv(steps).T
    return None if _is_off(errors - np.rint(errors), 1.5) else steps


def _apply(homography: Array, slopes: Array) -> Array:
    """Return the (N, 2) columns and rows of slopes (N, 2), or of points (N, 3)."""
    seen = slopes @ homography[:, :2].T + homography[:, 2] if slopes.shape[1] == 2 else slopes @ homography.T
    return np.asarray(seen[:, :2] / seen[:, 2:])


def _solve_homography(slopes: Array, pixels: Array, start: Array) -> Array:
    """Return the homography from slopes (N, 2) to pixels (N, 2) by Gauss-Newton steps from a first one."""
    found = start / start[2, 2]
    scale = max(float(np.abs(slopes).max()), 1e-12)
    x, y = slopes.T / scale
    found = found @ np.diag([scale, scale, 1.0])
    ones, zeros = np.ones(len(x)), np.zeros(len(x))
    # few pixels across show no perspective
    free = 8 if np.ptp(pixels, axis=0).min() > 20 else 6
    for _ in range(2):
        u, v, w = found @ np.stack([x, y, ones])
        column, row = u / w, v / w
        top = [x / w, y / w, ones / w, zeros, zeros, zeros, -column * x / w, -column * y / w]
        low = [zeros, zeros, zeros, x / w, y / w, ones / w, -row * x / w, -row * y / w]
        matrix = np.vstack([np.column_stack(top), np.column_stack(low)])[:, :free]
        wrong = np.concatenate([pixels[:, 0] - column, pixels[:, 1] - row])
        change, *_ = np.linalg.lstsq(matrix, wrong, rcond=None)
        flat = found.ravel()
        flat[:free] += change
        found = flat.reshape(3, 3)
    return np.asarray(found @ np.diag([1.0 / scale, 1.0 / scale, 1.0]))


def _make_camera(homography: Array, points: Array, frame: Array) -> PixelGrid | None:
    """Return the camera with a homography from slopes in a frame to pixels; None if no camera has it."""
    matrix = homography @ frame.T
    seen = points[:: max(len(points) // _SAMPLE, 1)]
    if matrix[2] @ seen.mean(axis=0) < 0:
        matrix = -matrix
    if np.linalg.det(matrix) < 0:
        # rows run down, so that columns, rows and depths are right-handed
        matrix = np.diag([1.0, -1.0, 1.0]) @ matrix
    inner, turn = _split(matrix)
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    quarters = [np.linalg.matrix_power(quarter, count) for count in range(4)]
    # columns run along the cloud's first axis, as far as they can
    best = max(quarters, key=lambda one: tuple(np.round(np.diag(one @ turn), 6)))
    inner, turn = best @ inner @ best.T, best @ turn
    leveled = _level(turn, seen, np.rint(_apply(inner @ turn, seen)))
    if leveled is not None:
        return leveled
    fx, skew, cx = inner[0].tolist()
    fy, cy = inner[1, 1:].tolist()
    if abs(skew) > _MAX_SKEW * fx or not 1.0 / _MAX_ASPECT < fx / fy < _MAX_ASPECT:
        return None
    return PixelGrid(Pinhole((fx, fy), (cx, cy)), turn.T)


def _level(turn: Array, points: Array, pixels: Array) -> PixelGrid | None:
    """Return the camera along the cloud's own axes that shows points in pixels (N, 2), if any."""
    level = np.rint(turn)
    if np.abs(turn - level).max() > _MAX_LEVELED or abs(np.linalg.det(level)) < 0.5:
        return None
    x, y, z = (points @ level.T).T
    if not (z > 0).all():
        return None
    columns, rows = pixels.T
    fx, cx, error_across = _fit_axis(x / z, columns)
    fy, cy, error_down = _fit_axis(y / z, rows)
    if not max(error_across, error_down) < _MAX_ERROR:
        return None
    return PixelGrid(Pinhole((fx, fy), (cx, cy)), level.T)


def _split(matrix: Array) -> tuple[Array, Array]:
    """Return an upper triangular matrix with a positive diagonal that ends with one, and a rotation."""
    flipped = matrix[::-1].T
    turn, inner = np.linalg.qr(flipped)
    inner, turn = inner.T[::-1, ::-1], turn.T[::-1]
    signs = np.sign(np.diag(inner))
    inner, turn = inner * signs, turn * signs[:, None]
    return inner / inner[2, 2], turn


def _fit_axis(slopes: Array, pixels: Array) -> tuple[float, float, float]:
    """Return focal length, center and root mean square error of columns or rows by slopes."""
    matrix = np.column_stack([slopes, np.ones(len(slopes))])
    (focal, center), *_ = np.linalg.lstsq(matrix, pixels, rcond=None)
    return float(focal), float(center), float(np.sqrt(np.mean((matrix @ [focal, center] - pixels) ** 2)))


def _is_filled(points: Array, grid: PixelGrid) -> bool:
    """Tell whether points have pixels of their own, and most of these pixels lie beside others."""
    columns, rows = np.rint(grid.camera.project(points @ grid.turn)).astype(np.int64).T
    columns, rows = columns - columns.min(), rows - rows.min()
    if (columns.max() + 1.0) * (rows.max() + 1.0) > _MAX_PIXELS:
        return False
    taken = np.zeros((rows.max() + 1, columns.max() + 1), dtype=bool)
    taken[rows, columns] = True
    count = np.count_nonzero(taken)
    beside = np.count_nonzero(taken[1:] & taken[:-1]) + np.count_nonzero(taken[:, 1:] & taken[:, :-1])
    return bool(count > _MIN_OWN_PIXELS * len(points) and beside > 2 * _MIN_FILLED * count)
