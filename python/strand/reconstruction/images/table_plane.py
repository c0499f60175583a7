"""The plane that ropes lie on, as the cameras saw it around them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.reconstruction.images.rope_image import RopeImage
from strand.support.checks import Array

# points, planes through three of them that are tried, each compared with one point of so many, and the
# share of points that a table needs
_POINTS, _TRIES, _EACH, _SHARE = 1500, 150, 3, 0.5
# pixels around the ropes that are left out, and how far the table is looked for, in radii
_EDGE, _AROUND = 4, 40.0
# points of the table scatter by this much, in radii
_SCATTER = 1.0


def table_plane(images: Sequence[RopeImage], reference: int, radius: float) -> tuple[Array, float] | None:
    """Find the plane that most points beside the ropes lie on.

    Parameters
    ----------
    images : sequence of RopeImage
    reference : int
        The view that is asked first: its pose is right by definition.
    radius : float
        Metres.

    Returns
    -------
    ((3,) ndarray, float) or None
        Its unit normal n towards the camera and n.x, metres; None if there is none or the view saw nothing
        beside the ropes.
    """
    image = images[reference]
    points = _beside(image, radius)
    if len(points) < 100:
        return None
    random = np.random.default_rng(0)
    corners = points[random.integers(0, len(points), (_TRIES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    kept = lengths > 1e-12
    normals, corners = normals[kept] / lengths[kept, None], corners[kept, 0]
    if not len(normals):
        return None
    offsets = (normals * corners).sum(axis=1)
    # a part of the points tells planes apart; a product of matrices would wake threads of BLAS
    (x, y, z), wide = points[::_EACH].T.copy(), _SCATTER * radius
    nx, ny, nz = normals.T[:, :, None]
    on = np.count_nonzero(np.abs(nx * x + ny * y + nz * z - offsets[:, None]) < wide, axis=1)
    best = int(np.argmax(on))
    near = np.abs(points @ normals[best] - offsets[best]) < wide
    if np.count_nonzero(near) < _SHARE * len(points):
        return None
    for _ in range(3):
        own = points[near]
        middle = own.mean(axis=0)
        own -= middle
        normal = np.linalg.eigh(own.T @ own)[1][:, 0]
        near = np.abs((points - middle) @ normal) < wide
        if np.count_nonzero(near) < 100:
            return None
    if normal @ (image.pose[:3, 3] - middle) < 0:
        normal = -normal
    return normal, float(normal @ middle)


def _beside(image: RopeImage, radius: float) -> Array:
    """Points, world frame, of pixels around the ropes but not next to them."""
    rows, columns = (np.flatnonzero(image.mask.any(axis=axis)) for axis in (1, 0))
    far = float(np.median(image.depth[image.mask]))
    height, width = image.mask.shape
    reach = _EDGE
    if far > 0:
        reach = int(min(_AROUND * radius * image.focal[0] / max(far, 1e-9), height + width))
    top, bottom = max(rows[0] - reach, 0), min(rows[-1] + reach + 1, height)
    left, right = max(columns[0] - reach, 0), min(columns[-1] + reach + 1, width)
    step = max(int(np.sqrt((bottom - top) * (right - left) / (2.0 * _POINTS))), 1)
    z = image.depth[top:bottom:step, left:right:step]
    kept = z > 0
    steps = (-_EDGE, 0, _EDGE)
    down = [np.clip(np.arange(top, bottom, step) + dv, 0, height - 1) for dv in steps]
    for du in steps:
        beside = image.mask[:, np.clip(np.arange(left, right, step) + du, 0, width - 1)]
        for chosen in down:
            kept &= ~beside[chosen]
    v, u = np.nonzero(kept)
    return image.world(top + step * v, left + step * u, z[kept])
