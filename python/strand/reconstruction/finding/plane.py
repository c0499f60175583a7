"""The plane that most of what a camera sees lies on: a table, a floor, a wall."""

from __future__ import annotations

import numpy as np

from strand.support.checks import Array
from strand.support.robust import robust_deviation

# planes through three points that are tried, and points that each is compared with
_TRIES, _COMPARED = 300, 3000
# how far from the plane points may lie: first, of their median distance; then in standard deviations of what
# lies on it, at least so much of the distance
_FIRST, _DEVIATIONS, _LEAST, _ROUNDS = 0.01, 3.0, 0.002, 4
# three points whose angle has a smaller sine lie on a line
_STRAIGHT = 1e-6
_AT_ONCE = 20


def largest_plane(points: Array) -> tuple[Array, float, float] | None:
    """Find the plane that most points lie on.

    RANSAC: planes through three points that are drawn from a fixed seed are compared by how many points lie
    on them; a plane is fitted to those of the best by least squares, again and again as the points' scatter
    shows how far from it they may be.

    Parameters
    ----------
    points : (N, 3) ndarray
        In the frame of the camera that saw them, metres.

    Returns
    -------
    ((3,) ndarray, float, float) or None
        Its unit normal n towards the camera, n.x, metres, and the share of the points that lie on it; None if
        three points do not fix one.
    """
    if len(points) < 3:
        return None
    rng = np.random.default_rng(0)
    wide = _FIRST * float(np.median(np.linalg.norm(points, axis=1)))
    some = points[rng.integers(0, len(points), min(_COMPARED, len(points)))]
    corners = points[rng.integers(0, len(points), (_TRIES, 3))]
    edges = corners[:, 1:] - corners[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    lengths = np.linalg.norm(normals, axis=1)
    kept = lengths > _STRAIGHT * np.linalg.norm(edges, axis=2).prod(axis=1)
    if not kept.any():
        return None
    normals = normals[kept] / lengths[kept, None]
    offsets = (normals * corners[kept, 0]).sum(axis=1)
    x, y, z = some.T.copy()
    best, most = 0, -1
    for first in range(0, len(normals), _AT_ONCE):
        nx, ny, nz = normals[first : first + _AT_ONCE].T[:, :, None]
        away = np.abs(nx * x + ny * y + nz * z - offsets[first : first + _AT_ONCE, None])
        counts = np.count_nonzero(away < wide, axis=1)
        if counts.max() > most:
            best, most = first + int(counts.argmax()), int(counts.max())
    normal, offset = normals[best], float(offsets[best])
    least = _LEAST / _FIRST * wide
    for _ in range(_ROUNDS):
        near = np.abs(points @ normal - offset) < wide
        own = points[near]
        if len(own) < 3:
            return None
        middle = own.mean(axis=0)
        from_middle = own - middle
        normal = np.linalg.eigh(from_middle.T @ from_middle)[1][:, 0]
        offset = float(normal @ middle)
        scatter = robust_deviation(from_middle @ normal)
        wide = max(_DEVIATIONS * scatter, least)
    if offset > 0.0:
        normal, offset = -normal, -offset
    share = float(np.mean(np.abs(points @ normal - offset) < wide))
    return normal, offset, share


def in_plane(normal: Array) -> Array:
    """(3, 2) Two directions at right angles in a plane, from its unit normal."""
    aside = np.cross(np.eye(3)[np.abs(normal).argmin()], normal)
    aside /= np.linalg.norm(aside)
    return np.column_stack([aside, np.cross(normal, aside)])
