"""Ropes that are laid along chains of a reconstruction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.tracking.frame import Frame
from strand.tracking.rope_state import RopeState, measure_arcs, place_at

_SAME_LENGTH = 0.02  # of the length: a chain this much off is laid from end to end
_SAME_LENGTH_RADII = 2.0  # radii: likewise
_OFFSETS = 9  # places along a longer or shorter chain that are tried
_ENOUGH = 0.004  # share of the mask by which one place along a chain is better than another
_MOST_COVERED = 18.0  # radii beyond an end, where what covers it is sought
_USUALLY_COVERED = 3.5  # radii of rope that a gripper hides beyond what is seen
_COVER_ERROR = 0.35  # of what is taken to be covered: its deviation
_LENGTH_ERROR = 0.01  # of the length: its deviation where both ends are seen
_WINDOW = 3.0  # radii to each side of a place, in which masks support it
_SUPPORT = 0.5  # share of these places that lie in a mask
_AHEAD = 1.5  # radii beyond the end, where what covers it is sought first
_FIRST = 6  # places half a radius apart, in one of which it begins
_BESIDE = 1.5  # radii beside the straight way, where it counts too
_NEARER = 2.0  # radii: what covers an end is this much nearer


def lay_ropes(ropes: Sequence[RopeState], chains: Sequence[Chain]) -> tuple[Array, ...] | None:
    """Return the nodes (M, 3) of each rope on the chain that it fits best; None with fewer chains than ropes.

    A rope keeps its direction. On a shorter or a longer chain, it lies where that agrees best with its nodes.
    """
    if len(chains) < len(ropes):
        return None
    options = [[_lay(rope, chain.points) for chain in chains] for rope in ropes]
    order = _assign(np.array([[cost for _, cost in row] for row in options]))
    return tuple(options[i][j][0] for i, j in enumerate(order))


def _lay(rope: RopeState, points: Array) -> tuple[Array, float]:
    s = rope.spacing * np.arange(len(rope.nodes))
    best: tuple[Array, float] = (rope.nodes, np.inf)
    for line in (points, points[::-1]):
        arcs = measure_arcs(line)
        longer = rope.length - arcs[-1]
        if abs(longer) <= max(_SAME_LENGTH * rope.length, _SAME_LENGTH_RADII * rope.radius):
            candidates = [place_at(line, arcs, s * arcs[-1] / rope.length)]
        else:
            shifts = np.linspace(min(0.0, longer), max(0.0, longer), _OFFSETS)
            candidates = [place_at(line, arcs, s - shift) for shift in shifts]
        for nodes in candidates:
            cost = float(np.linalg.norm(nodes - rope.nodes, axis=1).mean())
            if cost < best[1]:
                best = nodes, cost
    return best


def _assign(costs: Array) -> list[int]:
    """Return a column for each row, greedily by the least cost."""
    free = costs.copy()
    chosen = [-1] * len(costs)
    for _ in range(len(costs)):
        i, j = np.unravel_index(int(np.argmin(free)), free.shape)
        chosen[int(i)] = int(j)
        free[i, :], free[:, j] = np.inf, np.inf
    return chosen


def fit_length(points: Array, radius: float, length: float | None, frame: Frame) -> tuple[Array, float]:
    """Return a chain's points, longer or shorter where its ends or its length tell so, and the deviation.

    Something may cover an end, such as a gripper that holds it. Without a known length, the rope is
    taken to go on below what covers it, as far as a gripper usually hides.
    """
    arcs = measure_arcs(points)
    covered = [measure_cover(line, radius, frame) for line in (points, points[::-1])]
    if length is None:
        more = [min(reach, _USUALLY_COVERED * radius) for reach in covered]
        s = np.linspace(-more[0], arcs[-1] + more[1], len(points))
        deviation = math.hypot(*(_COVER_ERROR * reach for reach in more), _LENGTH_ERROR * arcs[-1])
        return place_at(points, arcs, s), deviation
    missing = length - arcs[-1]
    if missing < 0:
        return _cut(points, arcs, length, frame), 0.0
    total = covered[0] + covered[1]
    # rope that nothing hides is not there, however long it is said to be
    most = total + _SAME_LENGTH_RADII * radius + _SAME_LENGTH * arcs[-1]
    unseen, missing = max(missing - most, 0.0), min(missing, most)
    shares = [0.5, 0.5] if total <= 0 else [reach / total for reach in covered]
    if total <= 0 and missing <= _SAME_LENGTH_RADII * radius:
        return points, unseen
    s = np.linspace(-shares[0] * missing, arcs[-1] + shares[1] * missing, len(points))
    return place_at(points, arcs, s), unseen


def _cut(points: Array, arcs: Array, length: float, frame: Frame) -> Array:
    """Return the stretch of a length that the masks support best."""
    best: tuple[float, Array] = (-1.0, points)
    for start in np.linspace(0.0, arcs[-1] - length, _OFFSETS):
        line = place_at(points, arcs, start + np.linspace(0.0, length, len(points)))
        shares = []
        for _, image, mask in frame.images:
            rows, columns, inside = image.find_pixels(line)
            shares.append(float(mask[rows[inside], columns[inside]].mean()) if inside.any() else 0.0)
        if max(shares, default=0.0) > best[0] + _ENOUGH:
            best = max(shares, default=0.0), line
    return best[1]


def trim_ends(chain: Chain, frame: Frame) -> Chain:
    """Return a chain without ends outside the masks: a few false pixels may have drawn them there."""
    if not frame.is_masked or chain.closed:
        return chain
    points = np.asarray(chain.points)
    on = np.zeros(len(points))
    for _, image, mask in frame.images:
        rows, columns, inside = image.find_pixels(points)
        on[inside] = np.maximum(on[inside], mask[rows[inside], columns[inside]])
    half = max(round(_WINDOW * chain.radius * len(points) / chain.length), 1)
    sums = np.concatenate([[0.0], np.cumsum(on)])
    low = np.maximum(np.arange(len(points)) - half, 0)
    high = np.minimum(np.arange(len(points)) + half + 1, len(points))
    held = np.flatnonzero((sums[high] - sums[low]) >= _SUPPORT * (high - low))
    if not len(held) or held[-1] - held[0] < 2 * half or held[-1] - held[0] == len(points) - 1:
        return chain
    kept = points[held[0] : held[-1] + 1]
    return replace(chain, points=kept, curve=None, covariance=None, points_seen=None, views_seen=None)


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
