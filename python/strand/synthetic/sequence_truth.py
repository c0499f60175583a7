"""The truth of a sequence's frames: which nodes the camera sees, and which strand lies on top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand._core import find_crossed_segments
from strand.support.checks import Array

_NEAR = 0.35  # radii: a visible place this near to a rope's surface is on it
_REACH = 3  # nodes before and after a node whose surface shows this node
_MIN_BETWEEN = 4.0  # radii of rope between two strands that cross


@dataclass(frozen=True)
class TrueCrossing:
    """One strand over another, as seen from above.

    Attributes
    ----------
    over, under : (int, float)
        Number of the rope and arc length from its first node, metres, of the upper and the lower strand.
    """

    over: tuple[int, float]
    under: tuple[int, float]


def find_crossings(
    nodes: tuple[Array, ...], spacings: tuple[float, ...], radius: float
) -> tuple[TrueCrossing, ...]:
    """Return where strands cross as seen from above; lengths are in metres."""
    counts = [len(rope) for rope in nodes]
    number = np.repeat(np.arange(len(nodes)), np.array(counts) - 1)
    within = np.concatenate([np.arange(count - 1) for count in counts])
    start = within + np.cumsum([0, *counts[:-1]])[number]
    places = np.concatenate(nodes)
    plan = np.ascontiguousarray(places[:, :2])
    pairs, shares, _ = find_crossed_segments(plan, np.stack([start, start + 1], axis=1))
    ropes, first = number[pairs], start[pairs]
    along = (within[pairs] + shares) * np.asarray(spacings)[ropes]
    height = (1.0 - shares) * places[first, 2] + shares * places[first + 1, 2]
    apart = (ropes[:, 0] != ropes[:, 1]) | (np.abs(along[:, 0] - along[:, 1]) >= _MIN_BETWEEN * radius)
    found = []
    for k in np.flatnonzero(apart):
        upper = 0 if height[k, 0] >= height[k, 1] else 1
        over, under = ((int(ropes[k, i]), float(along[k, i])) for i in (upper, 1 - upper))
        found.append(TrueCrossing(over, under))
    return tuple(found)


def find_unseen(
    rope: Array, radius: float, depth: Array, intrinsics: Array, pose: Array
) -> NDArray[np.bool_]:
    """Return (N,) whether the pixel of a node shows something else than the rope around this node.

    `depth` (H, W) is exact, metres.
    """
    seen = (rope - pose[:3, 3]) @ pose[:3, :3]
    size = np.array(depth.shape[::-1])
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = np.rint((seen @ intrinsics.T)[:, :2] / seen[:, 2:])
    inside = ((pixels >= 0) & (pixels < size)).all(axis=1) & (seen[:, 2] > 0)
    columns, rows = np.where(inside[:, None], pixels, 0.0).astype(np.int64).T
    rays = np.column_stack([columns, rows, np.ones(len(rope))]) @ np.linalg.inv(intrinsics).T
    shown = rays * depth[rows, columns][:, None]
    least = np.full(len(rope), np.inf)
    for shift in range(-_REACH, _REACH):
        first = np.clip(np.arange(len(rope)) + shift, 0, len(rope) - 2)
        along = seen[first + 1] - seen[first]
        share = ((shown - seen[first]) * along).sum(axis=1) / (along**2).sum(axis=1)
        nearest = seen[first] + np.clip(share, 0.0, 1.0)[:, None] * along
        least = np.minimum(least, np.linalg.norm(shown - nearest, axis=1))
    return np.asarray(~inside | (least > (1.0 + _NEAR) * radius))
