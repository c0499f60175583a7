"""The measure of a reconstruction: its chains beside the true centrelines.

Chains and centrelines are resampled every millimetre. The topology is right if there are as many chains as
ropes, and each stays within 1.5 radii of its rope by the discrete Fréchet distance. Then it runs through the
rope from end to end, in order, without a shortcut, jump or gap. Chains are assigned to ropes, and reversed,
so that these distances are least. Errors are measured in order along the rope, so that a chain gains nothing
by lying near another strand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

Array = NDArray[np.float64]

STEP = 1e-3  # metres between compared nodes
MAX_FRECHET = 1.5  # radii: a chain within this distance follows its rope
MIN_STEPS = 8  # along a rope, between strands that cross
MAX_SHIFT = 4.0  # radii of arc length, from a found crossing to its true one
MIN_SINE = 1e-9  # of the angle between segments that cross


@dataclass(frozen=True)
class Crossings:
    """Crossings of ropes with themselves, seen from above.

    Attributes
    ----------
    found, true : int
        Crossings of the chains and of the ropes.
    right : int
        True crossings with a found one at the same places along the rope, and the same strand on top.
    """

    found: int
    true: int
    right: int


@dataclass(frozen=True)
class Measure:
    """Match of chains and ropes.

    Attributes
    ----------
    chains, ropes : int
        Number of chains and of ropes.
    right : bool
        Whether the topology is right.
    frechet : float
        Discrete Fréchet distance in radii, of the worst rope; infinite if a rope has no chain.
    rms : float
        Root mean square distance of the chains' nodes from their ropes, in order along them, metres;
        infinite if there are no chains.
    length_error : float
        Difference of the lengths over the rope's, of the worst rope that has a chain; infinite if there
        are no chains.
    crossings : Crossings
    """

    chains: int
    ropes: int
    right: bool
    frechet: float
    rms: float
    length_error: float
    crossings: Crossings


def measure_chains(chains: Sequence[ArrayLike], truth: Sequence[ArrayLike], radius: float) -> Measure:
    """Compare chains with ropes.

    Parameters
    ----------
    chains, truth : sequence of (N, 3) array_like
        Nodes of the chains and of the ropes' centrelines in one frame, metres, end to end. Chains of fewer
        than two nodes do not count.
    radius : float
        The ropes' radius, metres.
    """
    ropes = [resampled(nodes) for nodes in truth]
    found = [resampled(nodes) for nodes in chains if len(np.asarray(nodes)) >= 2]
    if not found:
        return Measure(0, len(ropes), False, math.inf, math.inf, math.inf, Crossings(0, 0, 0))
    # each chain in the direction that is nearer to the rope, with its distance
    fits = [
        [
            min(((compute_frechet(way, rope), way) for way in (chain, chain[::-1])), key=lambda fit: fit[0])
            for rope in ropes
        ]
        for chain in found
    ]
    distances = np.array([[distance for distance, _ in row] for row in fits])
    assigned = list(zip(*linear_sum_assignment(distances), strict=True))
    pairs = [(fits[i][j][1], ropes[j]) for i, j in assigned]
    worst = max(distances[i, j] for i, j in assigned) / radius if len(found) >= len(ropes) else math.inf
    lengths = [(compute_arc_lengths(chain)[-1], compute_arc_lengths(rope)[-1]) for chain, rope in pairs]
    counts = [match_crossings(chain, rope, radius) for chain, rope in pairs]
    return Measure(
        chains=len(found),
        ropes=len(ropes),
        right=len(found) == len(ropes) and bool(worst <= MAX_FRECHET),
        frechet=float(worst),
        rms=float(np.sqrt(np.mean([compute_rms_in_order(chain, rope) ** 2 for chain, rope in pairs]))),
        length_error=float(max(abs(length - true) / true for length, true in lengths)),
        crossings=Crossings(*(sum(column) for column in zip(*counts, strict=True))),
    )


def compute_arc_lengths(nodes: Array) -> Array:
    """Return (N,) the length along straight segments from the first node to each, metres."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(nodes, axis=0), axis=1))])


def resampled(nodes: ArrayLike) -> Array:
    """Return (M, 3) nodes a step apart along straight segments, with both ends."""
    nodes = np.asarray(nodes, dtype=np.float64)
    at = compute_arc_lengths(nodes)
    s = np.linspace(0.0, at[-1], max(round(at[-1] / STEP) + 1, 2))
    return np.stack([np.interp(s, at, nodes[:, k]) for k in range(3)], axis=1)


def compute_frechet(a: Array, b: Array) -> float:
    """Return the discrete Fréchet distance of two curves (Eiter and Mannila 1994), metres.

    The shortest leash that lets two walkers go from end to end, node by node and never back:
    C[i, j] = max(D[i, j], min(C[i-1, j], C[i, j-1], C[i-1, j-1])).
    """
    distances = cdist(a, b)
    n, m = distances.shape
    # an antidiagonal i + j = k depends on the two before it; index i, with one place before the first
    before, last = np.full(n + 1, np.inf), np.full(n + 1, np.inf)
    last[1] = distances[0, 0]
    for k in range(1, n + m - 1):
        i = np.arange(max(0, k - m + 1), min(n - 1, k) + 1)
        leash = np.full(n + 1, np.inf)
        leash[i + 1] = np.maximum(
            distances[i, k - i], np.minimum(np.minimum(last[i], last[i + 1]), before[i])
        )
        before, last = last, leash
    return float(last[n])


def compute_rms_in_order(chain: Array, rope: Array) -> float:
    """Return the root mean square distance of nodes from a rope, metres.

    The matching of nodes with segments has the least sum of squares. No node goes back before the segment of
    the previous node.
    """
    start, step = rope[:-1], np.diff(rope, axis=0)
    offset = chain[:, None] - start
    along = np.clip((offset * step).sum(axis=2) / (step**2).sum(axis=1), 0.0, 1.0)
    squares = np.linalg.norm(offset - along[..., None] * step, axis=2) ** 2
    cost = squares[0]
    for row in squares[1:]:
        cost = row + np.minimum.accumulate(cost)
    return float(np.sqrt(cost.min() / len(chain)))


def match_crossings(chain: Array, rope: Array, radius: float) -> tuple[int, int, int]:
    """Return the number of the chain's crossings, of the rope's, and of those that both have."""
    here, there = find_crossings(chain), find_crossings(rope)
    left = list(range(len(here)))
    for place in there:
        same = np.abs(here[left, :2] - place[:2]) < MAX_SHIFT * radius
        same = same.all(axis=1) & (np.sign(here[left, 2]) == np.sign(place[2]))
        if same.any():
            del left[int(same.argmax())]
    return len(here), len(there), len(here) - len(left)


def find_crossings(nodes: Array) -> Array:
    """Return (K, 3) the crossings of a curve with itself as seen along z.

    Each row has the two arc lengths, the smaller first, and the height of the second strand over the first,
    metres.
    """
    start, step = nodes[:-1], np.diff(nodes, axis=0)
    i, j = np.triu_indices(len(step), k=MIN_STEPS)
    offset = start[j] - start[i]
    # start_i + t step_i meets start_j + u step_j in the plane
    size = _cross_product(step[i], step[j])
    with np.errstate(divide="ignore", invalid="ignore"):
        t, u = _cross_product(offset, step[j]) / size, _cross_product(offset, step[i]) / size
    meet = (t >= 0) & (t < 1) & (u >= 0) & (u < 1)
    # along a straight rope t and u are rounding errors over rounding errors
    meet &= np.abs(size) > MIN_SINE * STEP**2
    i, j, t, u = i[meet], j[meet], t[meet], u[meet]
    at, height = compute_arc_lengths(nodes), nodes[:, 2]
    return np.stack(
        [
            at[i] + t * (at[i + 1] - at[i]),
            at[j] + u * (at[j + 1] - at[j]),
            height[j] + u * step[j, 2] - height[i] - t * step[i, 2],
        ],
        axis=1,
    )


def _cross_product(a: Array, b: Array) -> Array:
    """Return the cross products of vectors in the plane."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
