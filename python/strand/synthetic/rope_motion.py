"""Ropes in motion: an inextensible, flexible line with weight, on a table, held by grippers.

Every step bends and moves the ropes implicitly, then moves nodes back to the lengths between neighbours,
out of the table and out of other strands. The bending is linear in the nodes, so its matrix is inverted once
for each set of held nodes. The lengths of a rope are a tridiagonal system.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

STEP = 1.0 / 480.0
"""Time between two states of the simulation, seconds."""

_GRAVITY = 9.81  # m / s^2
_STIFFNESS = 3e-4  # m^4 / s^2: bending stiffness over mass per length; its weight bends 31 mm of rope
_MAX_TURN = math.radians(28.0)  # radians: between neighbouring segments
_BEND_DAMPING = 0.001  # seconds: damping over stiffness; more would let friction hold zigzags
_DRAG = 1.5  # 1 / s: of the air
_SETTLE_DRAG = 6.0  # 1 / s: while a rope comes to rest before the first frame
_FRICTION = 0.6  # of a rope on the table
_STRAND_FRICTION = 0.2  # of a strand on another one
_ITERATIONS = 2  # per step, of lengths and contacts
_MORE_ITERATIONS = 3  # at most, of lengths
_MAX_STRETCH = 0.004  # of the length between nodes; more needs another iteration
_COMPLIANCE = 1e-5  # of the lengths, relative: keeps straight ropes between two grippers solvable
_SAME_STRAND = 3.5  # radii of rope within which nodes do not collide
_LOOK_EVERY = 4  # steps between searches for strands that are near each other
_REACH = 3.0  # radii by which strands may approach between two searches
_MAX_SPEED = 4.0  # m / s: of a node; a safeguard

_Indices = NDArray[np.intp]

Drive = Callable[[float], tuple[_Indices, Array]]
"""Held nodes (K,), and their places (K, 3), metres, at a time, seconds."""


def simulate(
    ropes: Sequence[Array],
    spacings: Sequence[float],
    radius: float,
    drive: Drive,
    times: Array,
    settle: float,
) -> list[tuple[Array, ...]]:
    """Return the nodes of ropes at times.

    Parameters
    ----------
    ropes : sequence of (N, 3) ndarray
        Nodes at the start, metres. The table is the plane z = 0.
    spacings : sequence of float
        Distance of neighbouring nodes of each rope, metres.
    radius : float
        Radius of the ropes, metres.
    drive : callable
        Held nodes of all ropes in one row, and their places at a time.
    times : (T,) ndarray
        Seconds, rising, from 0.
    settle : float
        Time that the ropes have to come to rest before time 0, seconds.

    Returns
    -------
    list of tuple of (N, 3) ndarray
        One entry for each time.
    """
    state = _Motion(ropes, spacings, radius)
    for _ in range(round(settle / STEP)):
        state.advance(*drive(0.0), _SETTLE_DRAG)
    state.velocity[:] = 0.0
    splits = np.cumsum([len(rope) for rope in ropes])[:-1]
    found: list[tuple[Array, ...]] = []
    count, before = 0, state.nodes.copy()
    for time in times:
        while count * STEP < time:
            before = state.nodes.copy()
            count += 1
            state.advance(*drive(count * STEP), _DRAG)
        share = 1.0 - (count - time / STEP) if count else 1.0
        found.append(tuple(np.split(before + share * (state.nodes - before), splits)))
    return found


class _Motion:
    """The nodes of all ropes in one row, and their speeds."""

    def __init__(self, ropes: Sequence[Array], spacings: Sequence[float], radius: float) -> None:
        self.nodes = np.concatenate(ropes)
        self.velocity = np.zeros_like(self.nodes)
        self.radius = radius
        count = len(self.nodes)
        numbers = np.repeat(np.arange(len(ropes)), [len(rope) for rope in ropes])
        joined = np.flatnonzero(numbers[1:] == numbers[:-1])
        self.first, self.second = joined, joined + 1
        self.lengths = np.asarray(spacings)[numbers[joined]]
        self.follows = (self.first[1:] == self.second[:-1]).astype(np.float64)
        self.before_bends = joined[:-1][np.diff(joined) == 1]
        self.widths = 2.0 * math.cos(0.5 * _MAX_TURN) * np.asarray(spacings)[numbers[self.before_bends]]
        self.rope_bends = np.zeros((count, count))
        for i in self.before_bends:
            row = np.zeros(count)
            row[i : i + 3] = 1.0, -2.0, 1.0
            self.rope_bends += _STIFFNESS / np.asarray(spacings)[numbers[i]] ** 4 * np.outer(row, row)
        apart = np.abs(np.subtract.outer(joined, joined)) * self.lengths.min()
        near = (numbers[joined][:, None] == numbers[joined]) & (apart <= _SAME_STRAND * radius)
        self.may_touch = np.triu(~near, 1)
        self.pairs: tuple[_Indices, _Indices] = (joined[:0], joined[:0])
        self.inverses: dict[bytes, tuple[Array, Array]] = {}
        self.steps = 0

    def advance(self, held: _Indices, places: Array, drag: float) -> None:
        """Move all nodes by one step; the held ones to their places."""
        inverse, weights = self._find_inverse(held)
        before = self.nodes.copy()
        pull = -(self.rope_bends @ before)
        pull[:, 2] -= _GRAVITY
        speeds = (1.0 - drag * STEP) * self.velocity + STEP * pull
        speeds[held] = (places - before[held]) / STEP
        self.nodes += STEP * (inverse @ speeds)
        self.nodes[held] = places
        if self.steps % _LOOK_EVERY == 0:
            self.pairs = self._find_pairs()
        self.steps += 1
        for _ in range(_ITERATIONS):
            self._limit_bends(weights)
            self._part_strands(before, weights)
            self._leave_table(before, weights)
            stretch = self._keep_lengths(weights)
        for _ in range(_MORE_ITERATIONS):
            if stretch < _MAX_STRETCH:
                break
            stretch = self._keep_lengths(weights)
        self.nodes[:, 2] = np.where(weights > 0, np.maximum(self.nodes[:, 2], self.radius), self.nodes[:, 2])
        self.velocity = (self.nodes - before) / STEP
        speed = np.linalg.norm(self.velocity, axis=1, keepdims=True)
        self.velocity *= np.minimum(1.0, _MAX_SPEED / np.maximum(speed, _MAX_SPEED))

    def _find_inverse(self, held: _Indices) -> tuple[Array, Array]:
        """Return the inverse of the implicit step's matrix, and (N,) 0 for held nodes and 1 for others."""
        key = held.tobytes()
        if key not in self.inverses:
            matrix = np.eye(len(self.nodes)) + (STEP**2 + _BEND_DAMPING * STEP) * self.rope_bends
            matrix[held] = np.eye(len(self.nodes))[held]
            weights = np.ones(len(self.nodes))
            weights[held] = 0.0
            self.inverses[key] = np.asarray(np.linalg.inv(matrix), dtype=np.float64), weights
        return self.inverses[key]

    def _find_pairs(self) -> tuple[_Indices, _Indices]:
        """Return the segments that may touch before the next search."""
        middles = 0.5 * (self.nodes[self.first] + self.nodes[self.second])
        squares = (middles**2).sum(axis=1)
        away = squares[:, None] + squares - 2.0 * (middles @ middles.T)
        reach = (2.0 + _REACH) * self.radius + self.lengths.max()
        a, b = np.nonzero((away < reach**2) & self.may_touch)
        return a, b

    def _limit_bends(self, weights: Array) -> None:
        """Move the neighbours of nodes apart where the rope turns too sharply."""
        first, last = self.before_bends, self.before_bends + 2
        ways = self.nodes[last] - self.nodes[first]
        widths = np.linalg.norm(ways, axis=1)
        sharp = np.flatnonzero(widths < self.widths)
        if not len(sharp):
            return
        first, last = first[sharp], last[sharp]
        total = np.maximum(weights[first] + weights[last], 1.0)
        size = (self.widths[sharp] - widths[sharp]) / (total * np.maximum(widths[sharp], 1e-9))
        push = 0.5 * size[:, None] * ways[sharp]
        change = np.zeros_like(self.nodes)
        np.add.at(change, first, -push)
        np.add.at(change, last, push)
        self.nodes += weights[:, None] * change

    def _part_strands(self, before: Array, weights: Array) -> None:
        """Move segments apart that are nearer than two radii."""
        if not len(self.pairs[0]):
            return
        a, b = self.pairs
        a0, a1, b0, b1 = self.first[a], self.second[a], self.first[b], self.second[b]
        s, t, apart = _find_nearest(self.nodes[a0], self.nodes[a1], self.nodes[b0], self.nodes[b1])
        away = np.linalg.norm(apart, axis=1)
        deep = np.flatnonzero(away < 2.0 * self.radius)
        if not len(deep):
            return
        nodes = np.stack([a0[deep], a1[deep], b0[deep], b1[deep]])
        s, t = s[deep], t[deep]
        shares = np.stack([1.0 - s, s, t - 1.0, -t])
        free = weights[nodes]
        total = np.maximum((free * shares**2).sum(axis=0), 0.05)
        normal = apart[deep] / np.maximum(away[deep, None], 1e-9)
        size = (2.0 * self.radius - away[deep]) / total
        moved = ((self.nodes[nodes] - before[nodes]) * shares[..., None]).sum(axis=0)
        moved -= (moved * normal).sum(axis=1, keepdims=True) * normal
        slip = np.linalg.norm(moved, axis=1) / total
        hold = np.minimum(1.0, _STRAND_FRICTION * size / np.maximum(slip, 1e-12)) / total
        push = size[:, None] * normal - hold[:, None] * moved
        change, count = np.zeros_like(self.nodes), np.zeros(len(self.nodes))
        np.add.at(change, nodes.ravel(), ((free * shares)[..., None] * push).reshape(-1, 3))
        np.add.at(count, nodes.ravel(), (free * np.abs(shares)).ravel())
        self.nodes += change / np.maximum(count, 1.0)[:, None]

    def _leave_table(self, before: Array, weights: Array) -> None:
        """Move nodes out of the table, and hold them by friction."""
        deep = np.maximum(self.radius - self.nodes[:, 2], 0.0) * weights
        self.nodes[:, 2] += deep
        moved = self.nodes[:, :2] - before[:, :2]
        most = np.maximum(np.hypot(moved[:, 0], moved[:, 1]), 1e-15)
        self.nodes[:, :2] -= np.minimum(1.0, _FRICTION * deep / most)[:, None] * moved

    def _keep_lengths(self, weights: Array) -> float:
        """Move nodes to their distances from their neighbours by a Newton step; return the stretch before."""
        ways = self.nodes[self.second] - self.nodes[self.first]
        lengths = np.linalg.norm(ways, axis=1)
        ways /= lengths[:, None]
        weight_first, weight_second = weights[self.first], weights[self.second]
        diagonal = weight_first + weight_second
        diagonal = np.where(diagonal > 0, diagonal + _COMPLIANCE, 1.0)
        beside = -weight_second[:-1] * (ways[:-1] * ways[1:]).sum(axis=1) * self.follows
        pulls = _solve_tridiagonal(diagonal.tolist(), beside.tolist(), (lengths - self.lengths).tolist())
        change = pulls[:, None] * ways
        self.nodes[self.first] += weight_first[:, None] * change
        self.nodes[self.second] -= weight_second[:, None] * change
        return float(np.abs(lengths / self.lengths - 1.0).max())


def _solve_tridiagonal(diagonal: list[float], beside: list[float], right: list[float]) -> Array:
    """Return the solution of a symmetric tridiagonal system."""
    count = len(diagonal)
    for i in range(1, count):
        factor = beside[i - 1] / diagonal[i - 1]
        diagonal[i] -= factor * beside[i - 1]
        right[i] -= factor * right[i - 1]
    right[-1] /= diagonal[-1]
    for i in range(count - 2, -1, -1):
        right[i] = (right[i] - beside[i] * right[i + 1]) / diagonal[i]
    return np.array(right)


def _find_nearest(a0: Array, a1: Array, b0: Array, b1: Array) -> tuple[Array, Array, Array]:
    """Return where pairs of segments are nearest, as shares (P,) of both, and the ways (P, 3) from b to a."""
    along_a, along_b, between = a1 - a0, b1 - b0, a0 - b0
    aa, bb = (along_a**2).sum(axis=1), (along_b**2).sum(axis=1)
    ab = (along_a * along_b).sum(axis=1)
    ac, bc = (along_a * between).sum(axis=1), (along_b * between).sum(axis=1)
    det = aa * bb - ab * ab
    s = np.clip((ab * bc - bb * ac) / np.maximum(det, 1e-12 * aa * bb), 0.0, 1.0)
    t = np.clip((ab * s + bc) / bb, 0.0, 1.0)
    s = np.clip((ab * t - ac) / aa, 0.0, 1.0)
    return s, t, between + s[:, None] * along_a - t[:, None] * along_b
