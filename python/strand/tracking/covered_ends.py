"""Ends of ropes that something covers, such as the gripper that holds them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

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
        places = places[ahead]
        if not len(places):
            continue
        nearest = np.linalg.norm(places[:, None] - lines, axis=2).min(axis=1)
        places = places[nearest > _AWAY * radius]
        if not len(places):
            continue
        middle = np.median(places, axis=0)
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
