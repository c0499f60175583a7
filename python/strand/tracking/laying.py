"""Ropes that are laid along chains of a reconstruction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.tracking.covered_ends import extend_end, measure_cover
from strand.tracking.frame import Frame
from strand.tracking.rope_state import RopeState, measure_arcs, place_at

_SAME_LENGTH = 0.02  # of the length: a chain this much off is laid from end to end
_SAME_LENGTH_RADII = 2.0  # radii: likewise
_OFFSETS = 9  # places along a longer or shorter chain that are tried
_ENOUGH = 0.004  # share of the mask by which one place along a chain is better than another
_USUALLY_COVERED = 3.5  # radii of rope that a gripper hides beyond what is seen
_COVER_ERROR = 0.35  # of what is taken to be covered: its deviation
_LENGTH_ERROR = 0.01  # of the length: its deviation where both ends are seen
_WINDOW = 3.0  # radii to each side of a place, in which masks support it
_SUPPORT = 0.5  # share of these places that lie in a mask


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


def fit_length(
    chain: Chain, chains: Sequence[Chain], length: float | None, frame: Frame
) -> tuple[Array, float]:
    """Return a chain's points, longer or shorter where its ends or its length tell so, and the deviation.

    Something may cover an end, such as a gripper that holds it. The rope goes on to where it is seen again;
    else, without a known length, as far as a gripper usually hides. `chains` are all that were found.
    """
    radius, points = chain.radius, np.asarray(chain.points)
    for _ in range(2):
        points = extend_end(points, radius, chains, frame)[::-1]
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
    if chain.closed:
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
