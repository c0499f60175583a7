"""Which segment goes on as which: split chains at crossings and reconnect them (section V-B, eq. 19-20)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np
import rustworkx as rx
from numpy.typing import NDArray

from strand import _core
from strand.config import Reconnection, Splitting
from strand.view import Array

Indices = NDArray[np.int64]
# rows of the distance matrix that are in memory at a time
_BLOCK = 512
# the ways to join four ends in two pairs
_PAIRINGS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))


def runs(marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Find the stretches of a path that are marked.

    Parameters
    ----------
    marked : (M,) ndarray of bool
        For each node.

    Returns
    -------
    (K, 2) ndarray of int64
        The first node of each stretch, and the one after its last.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], marked, [False]]).astype(np.int8)))
    return edges.astype(np.int64).reshape(-1, 2)


def path_length(nodes: Array) -> Array:
    """Arc length from the first of (M, 3) nodes to each of them, metres."""
    return _core.path_length(nodes)


def closes(chain: Array, reach: float, loop: float) -> bool:
    """Tell whether a chain comes back to its start: ends within `reach`, and longer than `loop`, metres."""
    return bool(np.linalg.norm(chain[-1] - chain[0]) <= reach and path_length(chain)[-1] > loop)


def separation(chains: Sequence[Array], neighborhood: float, closed: Sequence[bool]) -> tuple[Array, ...]:
    """Distance of each node from the rest of the string, d* (eq. 19-20).

    Parameters
    ----------
    chains : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    neighborhood : float
        Nodes of the same chain this near along it, metres of arc length, are a node's own neighbourhood
        and do not count.
    closed : sequence of bool
        Whether each chain goes on from its last node to its first.

    Returns
    -------
    tuple of (M,) ndarray
        d* for every node of every chain, metres; infinity where no other node counts.
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
            squared = ((chain[rows, None] - nodes[None]) ** 2).sum(axis=2)
            apart = np.abs(arc[rows, None] - arc[None])
            if ring:
                apart = np.minimum(apart, around - apart)
            squared[:, own][apart <= neighborhood] = np.inf
            nearest[own][rows] = np.sqrt(squared.min(axis=1))
        first += len(chain)
    return tuple(np.split(nearest, np.cumsum([len(chain) for chain in chains])[:-1]))


def crossing_nodes(distance: Array, threshold: float, prominence: float, closed: bool = False) -> Indices:
    """Nodes at which a chain is cut: the local minima of d*.

    A minimum counts if it lies under the threshold and d* rises by at least `prominence` on both sides of
    it before it falls below it again; so a chain's own end, where another one is near, is not cut.

    Parameters
    ----------
    distance : (M,) ndarray
        d* along one chain, metres.
    threshold, prominence : float
        Metres.
    closed : bool
        Whether the last node is followed by the first.

    Returns
    -------
    (C,) ndarray of int64
        Indices of nodes, ascending.
    """
    # a closed chain is gone round from its greatest d*, where no minimum is
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
    """Cut a chain on both sides of some of its nodes, which then belong to no segment.

    Parameters
    ----------
    chain : (M, 3) ndarray
        Ordered nodes, metres.
    nodes : (C,) ndarray of int64
        Indices of nodes, ascending.
    closed : bool
        Whether the last node is followed by the first.

    Returns
    -------
    list of (K, 3) ndarray
        The segments in order; empty ones are left out. A closed chain that is cut is gone round from its
        first cut.
    """
    if closed and len(nodes):
        chain, nodes = np.roll(chain, -nodes[0], axis=0), nodes - nodes[0]
    edges = [-1, *nodes.tolist(), len(chain)]
    return [chain[a + 1 : b] for a, b in pairwise(edges) if b - a > 1]


@dataclass(frozen=True, eq=False)
class Split:
    """Chains cut where they cross.

    Attributes
    ----------
    distances : tuple of (M,) ndarray
        d* along each chain, metres.
    cuts : tuple of (C,) ndarray of int64
        The nodes each chain is cut at.
    segments : tuple of (K, 3) ndarray
        What is left between the cuts, chain by chain.
    rings : tuple of int
        Numbers of the segments whose last node goes on to their first.
    """

    distances: tuple[Array, ...]
    cuts: tuple[Indices, ...]
    segments: tuple[Array, ...]
    rings: tuple[int, ...]


def split(chains: Sequence[Array], radius: float, config: Splitting) -> Split:
    """Split chains where they cross.

    Parameters
    ----------
    chains : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The string's radius, metres.
    config : Splitting

    Returns
    -------
    Split
    """
    closed = [closes(chain, config.closure * radius, config.neighborhood * radius) for chain in chains]
    distances = separation(chains, config.neighborhood * radius, closed)
    cuts: list[Indices] = []
    segments: list[Array] = []
    rings: list[int] = []
    for chain, distance, ring in zip(chains, distances, closed, strict=True):
        nodes = crossing_nodes(distance, config.threshold * radius, config.prominence * radius, ring)
        if ring and not len(nodes):
            rings.append(len(segments))
        cuts.append(nodes)
        segments += cut(chain, nodes, ring)
    return Split(distances, tuple(cuts), tuple(segments), tuple(rings))


@dataclass(frozen=True, eq=False)
class Ends:
    """The ends of segments: number 2k is the first node of segment k, 2k + 1 its last.

    Attributes
    ----------
    positions : (E, 3) ndarray
        Metres.
    directions : (E, 3) ndarray
        Unit vectors along the string, out of the segment.
    lengths : (E,) ndarray
        Arc length of the end's segment, metres.
    """

    positions: Array
    directions: Array
    lengths: Array


def segment_ends(segments: Sequence[Array], skip: float, span: float) -> Ends:
    """Find the ends of segments and their directions.

    Parameters
    ----------
    segments : sequence of (K, 3) ndarray
        Ordered nodes, metres.
    skip : float
        Nodes this near to the end do not count for its direction, metres of arc length.
    span : float
        The stretch over which the direction is taken, metres of arc length.

    Returns
    -------
    Ends
        The direction of an end whose segment is a single node is the zero vector.
    """
    outward = [end_direction(nodes, skip, span) for segment in segments for nodes in (segment[::-1], segment)]
    return Ends(
        np.array([node for segment in segments for node in (segment[0], segment[-1])]).reshape(-1, 3),
        np.array(outward).reshape(-1, 3),
        np.repeat([path_length(segment)[-1] for segment in segments], 2),
    )


def end_direction(nodes: Array, skip: float, span: float) -> Array:
    """Return the unit vector out of the last of (M, 3) nodes, over `span` of arc length, `skip` before it.

    A chain shorter than that gives the direction of the whole chain; a single node the zero vector.
    """
    return _core.end_direction(nodes, skip, span)


def group_ends(ends: Ends, numbers: Sequence[int], reach: float, loop: float) -> list[list[int]]:
    """Group the ends that meet at one crossing: up to four, nearest first.

    Parameters
    ----------
    ends : Ends
    numbers : sequence of int
        The ends that may meet others.
    reach : float
        Ends farther apart than this do not meet, metres.
    loop : float
        Both ends of a segment meet at a crossing only if it is longer than this, metres.

    Returns
    -------
    list of list of int
        Numbers of ends, each in at most one group of two to four.
    """
    count = len(ends.positions)
    distance = np.linalg.norm(ends.positions[:, None] - ends.positions[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    mates = np.arange(count) ^ 1
    short = ends.lengths <= loop
    distance[np.arange(count)[short], mates[short]] = np.inf
    distance[distance > reach] = np.inf
    nearest = np.argsort(distance, axis=1, kind="stable")

    def company(end: int, taken: set[int]) -> list[int]:
        """Return the end and up to three that meet it, without both ends of a short segment."""
        group = [end]
        for other in nearest[end].tolist():
            if len(group) == 4 or not np.isfinite(distance[end, other]):
                break
            if other not in taken and not (short[other] and other ^ 1 in group):
                group.append(other)
        return group

    def tightness(end: int) -> tuple[int, float]:
        group = company(end, set(range(count)) - set(numbers))
        return -len(group), float(distance[end, group[1:]].sum())

    groups: list[list[int]] = []
    taken = set(range(count)) - set(numbers)
    for end in sorted(numbers, key=tightness):
        if end not in taken:
            group = company(end, taken)
            if len(group) > 1:
                groups.append(group)
                taken.update(group)
    return groups


def pair_ends(group: Sequence[int], directions: Array, min_agreement: float) -> list[tuple[int, int]]:
    """Join the ends of a group whose directions agree best: two pairs of four, one pair of two or three.

    Parameters
    ----------
    group : sequence of int
        Numbers of two to four ends.
    directions : (E, 3) ndarray
        Outward unit vectors of all ends. Those of two ends that go on straight are opposite.
    min_agreement : float
        Cosine below which a single pair is not joined.

    Returns
    -------
    list of (int, int)
        Numbers of the ends that are joined.
    """
    agreement = -directions[list(group)] @ directions[list(group)].T
    if len(group) == 4:
        best = max(_PAIRINGS, key=lambda pairing: sum(agreement[a, b] for a, b in pairing))
        return [(group[a], group[b]) for a, b in best]
    a, b = max(combinations(range(len(group)), 2), key=lambda pair: agreement[pair])
    return [(group[a], group[b])] if agreement[a, b] >= min_agreement else []


@dataclass(frozen=True)
class Reconnected:
    """How segments make up strings.

    Attributes
    ----------
    joins : tuple of (int, int)
        Pairs of ends that are joined.
    meeting : frozenset of int
        Ends that meet others, joined or not.
    """

    joins: tuple[tuple[int, int], ...]
    meeting: frozenset[int]


def reconnect(parts: Split, radius: float, ropes: int | None, config: Reconnection) -> Reconnected:
    """Reconnect segments at crossings (fig. 13).

    Ends are grouped by four, nearest first, and joined by direction in each group; the ends that are left,
    far from all others, are those of the ropes. If there are more of them than the ropes have, the nearest
    ones that agree in direction are joined over a gap.

    Parameters
    ----------
    parts : Split
        The segments.
    radius : float
        The string's radius, metres.
    ropes : int or None
        How many ropes there are, if that is known.
    config : Reconnection

    Returns
    -------
    Reconnected
    """
    ends = segment_ends(parts.segments, config.skip * radius, config.span * radius)
    joins = [(2 * k, 2 * k + 1) for k in parts.rings]
    open_ends = sorted(set(range(len(ends.positions))) - {end for pair in joins for end in pair})
    groups = group_ends(ends, open_ends, config.reach * radius, config.loop * radius)
    joins += [pair for group in groups for pair in pair_ends(group, ends.directions, config.min_agreement)]
    meeting = {end for group in groups for end in group}
    if ropes is not None:
        free = sorted(set(open_ends) - {end for pair in joins for end in pair})
        gaps = sorted(
            (float(np.linalg.norm(ends.positions[a] - ends.positions[b])), a, b)
            for a, b in combinations(free, 2)
            if a ^ 1 != b and -ends.directions[a] @ ends.directions[b] >= config.min_agreement
        )
        left = set(free)
        for gap, a, b in gaps:
            if len(left) > 2 * ropes and gap <= config.gap * radius and {a, b} <= left:
                joins.append((a, b))
                left -= {a, b}
    return Reconnected(tuple(joins), frozenset(meeting))


def walk(segment_count: int, joins: Sequence[tuple[int, int]]) -> list[tuple[list[int], bool]]:
    """Order the segments along each string.

    Parameters
    ----------
    segment_count : int
    joins : sequence of (int, int)
        Pairs of ends; no end in two pairs.

    Returns
    -------
    list of (list of int, bool)
        For each string the ends at which its segments are entered, in order (2k: segment k forwards,
        2k + 1: backwards), and whether the last is joined to the first.
    """
    graph = rx.PyGraph()
    graph.add_nodes_from(range(2 * segment_count))
    graph.add_edges_from_no_data([(2 * k, 2 * k + 1) for k in range(segment_count)])
    graph.add_edges_from_no_data(list(joins))
    mate = {a: b for pair in joins for a, b in (pair, pair[::-1])}
    strings = []
    for component in sorted(rx.connected_components(graph), key=min):
        open_ends = sorted(end for end in component if end not in mate)
        end = open_ends[0] if open_ends else min(component)
        entered = [end]
        while len(entered) < len(component) // 2:
            entered.append(mate[entered[-1] ^ 1])
        strings.append((entered, not open_ends))
    return strings
