"""Ends of ropes that something covers, such as the gripper that holds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.tracking.frame import Frame
from strand.tracking.rope_state import measure_arcs, place_at

_MOST_COVERED = 18.0  # radii beyond an end, where what covers it is sought
_AHEAD = 1.5  # radii beyond the end, where what covers it is sought first
_FIRST = 6  # places half a radius apart, in one of which it begins
_BESIDE = 1.5  # radii beside the straight way, where it counts too
_NEARER = 2.0  # radii: what covers an end is this much nearer
_TIP = 6.0  # radii beyond what covers it, up to where the tip is seen again
_AWAY = 2.5  # radii from all chains: pixels of the tip are no nearer
_CONE = 0.7  # cosine of the angle at which they lie beyond the end
_TOGETHER = 3.0  # radii: they are this near to their middle
_TIP_AREA = 1.0  # square radii in the image that they cover at least
_TIP_PIXELS = 6  # likewise
_FARTHEST = 0.9  # share of them before the tip
_SOLID = 6  # pixels of the mask among a pixel and its neighbours; edges have fewer


def extend_end(points: Array, radius: float, chains: Sequence[Chain], frame: Frame) -> Array:
    """Return points (N, 3), and one more before the first if the rope is seen again beyond its cover."""
    reach = measure_cover(points, radius, frame)
    if reach <= 0:
        return points
    out = place_at(points, measure_arcs(points), np.array([-radius]))[0] - points[0]
    out /= np.linalg.norm(out)
    lines = np.concatenate([np.asarray(chain.points) for chain in chains])
    for _, image, mask in frame.images:
        rows, columns = np.nonzero(mask & (image.depth > 0))
        places = image.lift(rows, columns, image.depth[rows, columns])
        off = places - points[0]
        far = np.linalg.norm(off, axis=1)
        ahead = (off @ out > _CONE * far) & (far > _AWAY * radius) & (far < reach + _TIP * radius)
        # masks that were guessed by colour hold the edges of other things
        solid = mask if frame.is_masked else _find_solid(mask)
        places, solid = places[ahead], solid[rows[ahead], columns[ahead]]
        free = np.linalg.norm(places[:, None] - lines, axis=2).min(axis=1) > _AWAY * radius
        places, solid = places[free], solid[free]
        if not solid.any():
            continue
        middle = np.median(places[solid], axis=0)
        places = places[np.linalg.norm(places - middle, axis=1) < _TOGETHER * radius]
        wide = radius * image.camera.focal[0] / image.distance
        if len(places) < max(_TIP_PIXELS, _TIP_AREA * wide * wide):
            continue
        middle = places.mean(axis=0)
        way = middle - points[0]
        way /= np.linalg.norm(way)
        tip = float(np.quantile((places - middle) @ way, _FARTHEST))
        return np.concatenate([[middle + tip * way], points])
    return points


def _find_solid(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the (H, W) pixels of a mask that have many others around them."""
    height, width = mask.shape
    padded = np.pad(mask.astype(np.int8), 1)
    counts = sum(padded[r : r + height, c : c + width] for r in range(3) for c in range(3))
    return np.asarray(mask & (counts >= _SOLID))


def measure_cover(points: Array, radius: float, frame: Frame) -> float:
    """Return how far something nearer covers the way beyond the first point, metres; 0 if nothing does."""
    ahead = np.arange(_AHEAD, _MOST_COVERED, 0.5)
    line = place_at(points, measure_arcs(points), -ahead * radius)
    reach = 0.0
    for _, image, mask in frame.images:
        z = (line - image.pose[:3, 3]) @ image.pose[:3, 2]
        aside = np.cross(line[-1] - line[0], line.mean(axis=0) - image.pose[:3, 3])
        aside *= _BESIDE * radius / max(float(np.linalg.norm(aside)), 1e-12)
        covers = np.zeros(len(ahead), dtype=bool)
        for shift in (-1.0, 0.0, 1.0):
            rows, columns, inside = image.find_pixels(line + shift * aside)
            r, c = np.where(inside, rows, 0), np.where(inside, columns, 0)
            seen = image.blocked_depth[r, c]
            covers |= inside & (seen > 0) & (seen < z - _NEARER * radius) & ~mask[r, c]
        if covers[:_FIRST].any():
            reach = max(reach, float(ahead[np.flatnonzero(covers)[-1]]) * radius)
    return reach
