"""Cut chains where they cross.

Section V-B, eq. 19-20, fig. 11-12 of *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from strand.config import Splitting
from strand.geometry.polyline import path_length
from strand.support.checks import Array

Indices = NDArray[np.int64]
_BLOCK = 512  # rows of the distance matrix that are in memory at a time


def is_closed(chain: Array, reach: float, loop: float) -> bool:
    """Tell whether a chain's ends are within `reach` of each other and it is longer than `loop`, metres."""
    return bool(np.linalg.norm(chain[-1] - chain[0]) <= reach and path_length(chain)[-1] > loop)


def measure_separation(
    chains: Sequence[Array], neighborhood: float, closed: Sequence[bool]
) -> tuple[Array, ...]:
    """Return each node's distance from the rest of the string, d* (eq. 19-20), metres.

    Nodes of the same chain within the neighbourhood, metres of arc length, do not count; d* is infinite where
    no other node counts.
    """
    if not chains:
        return ()
    nodes = np.concatenate(chains)
    nearest = np.full(len(nodes), np.inf)
    first = 0
    for chain, ring in zip(chains, closed, strict=True):
        arc = path_length(chain)
        around = arc[-1] + np.linalg.norm(chain[0] - chain[-1])
        own = slice(first, first + len(chain))
        for start in range(0, len(chain), _BLOCK):
            rows = slice(start, start + _BLOCK)
            x, y, z = ((chain[rows, k, None] - nodes[:, k]) ** 2 for k in range(3))
            squared = x + y + z
            along = np.abs(arc[rows, None] - arc[None])
            if ring:
                along = np.minimum(along, around - along)
            squared[:, own][along <= neighborhood] = np.inf
            nearest[own][rows] = np.sqrt(squared.min(axis=1))
        first += len(chain)
    return tuple(np.split(nearest, np.cumsum([len(chain) for chain in chains])[:-1]))


def find_crossing_nodes(
    distance: Array, threshold: float, prominence: float, closed: bool = False
) -> Indices:
    """Return the nodes at which a chain is cut, ascending: local minima of its d*.

    A minimum counts if it is below the threshold, and if d* rises by the prominence on both sides before it
    falls below the minimum again. So a chain's own end is not cut where another strand is near.
    """
    # a closed chain starts at its greatest d*, where no minimum is
    order = np.arange(len(distance))
    if closed:
        order = np.roll(order, -int(distance.argmax()))
        order = np.append(order, order[0])
    cuts = []
    highest, lowest = -np.inf, -1
    for i in order.tolist():
        d = distance[i]
        if lowest < 0:
            highest = max(highest, d)
            if d <= highest - prominence:
                lowest = i
        elif d < distance[lowest]:
            lowest = i
        elif d >= distance[lowest] + prominence:
            if distance[lowest] < threshold:
                cuts.append(lowest)
            highest, lowest = d, -1
    return np.array(sorted(cuts), dtype=np.int64)


def cut(chain: Array, nodes: Indices, closed: bool = False) -> list[Array]:
    """Cut a chain on both sides of some nodes, ascending, which then belong to no segment.

    Empty segments are dropped. The segments of a closed chain start at its first cut.
    """
    if closed and len(nodes):
        chain, nodes = np.roll(chain, -nodes[0], axis=0), nodes - nodes[0]
    edges = [-1, *nodes.tolist(), len(chain)]
    return [chain[a + 1 : b] for a, b in pairwise(edges) if b - a > 1]


@dataclass(frozen=True, eq=False)
class Split:
    """Segments of chains that are cut where they cross.

    Attributes
    ----------
    distances : tuple of (M,) ndarray
        d* along each chain, metres.
    cuts : tuple of (C,) ndarray of int64
        The nodes that each chain is cut at.
    segments : tuple of (K, 3) ndarray
        The stretches between the cuts, chain by chain.
    rings : tuple of int
        Numbers of the segments whose last node goes on to their first.
    """

    distances: tuple[Array, ...]
    cuts: tuple[Indices, ...]
    segments: tuple[Array, ...]
    rings: tuple[int, ...]


def split(chains: Sequence[Array], radius: float, config: Splitting) -> Split:
    """Split chains where they cross."""
    closed = [is_closed(chain, config.closure * radius, config.neighborhood * radius) for chain in chains]
    distances = measure_separation(chains, config.neighborhood * radius, closed)
    cuts: list[Indices] = []
    segments: list[Array] = []
    rings: list[int] = []
    for chain, distance, ring in zip(chains, distances, closed, strict=True):
        nodes = find_crossing_nodes(distance, config.threshold * radius, config.prominence * radius, ring)
        if ring and not len(nodes):
            rings.append(len(segments))
        cuts.append(nodes)
        segments += cut(chain, nodes, ring)
    return Split(distances, tuple(cuts), tuple(segments), tuple(rings))
