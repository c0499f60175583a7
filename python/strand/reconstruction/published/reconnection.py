"""Which segment goes on as which: ends grouped by four per crossing and joined by direction.

Section V-B, fig. 13 of *Shape Modeling of A String And Recognition Using Distance Sensor*.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strand.config import Reconnection
from strand.geometry.polyline import end_direction, path_length
from strand.reconstruction.published.splitting import Split
from strand.support.checks import Array

# the ways to join four ends in two pairs
_PAIRINGS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))


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
