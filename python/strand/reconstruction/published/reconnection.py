"""Group the ends of segments by four per crossing, and join them by direction.

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

_PAIRINGS = (((0, 1), (2, 3)), ((0, 2), (1, 3)), ((0, 3), (1, 2)))  # ways to join four ends in two pairs


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


def find_ends(segments: Sequence[Array], skip: float, span: float) -> Ends:
    """Find the ends of segments; the direction at the end of a single node is the zero vector.

    Nodes nearer than `skip` to an end do not count for its direction, which is taken over `span`, both in
    metres of arc length.
    """
    outward = [end_direction(nodes, skip, span) for segment in segments for nodes in (segment[::-1], segment)]
    return Ends(
        np.array([node for segment in segments for node in (segment[0], segment[-1])]).reshape(-1, 3),
        np.array(outward).reshape(-1, 3),
        np.repeat([path_length(segment)[-1] for segment in segments], 2),
    )


def group_ends(ends: Ends, numbers: Sequence[int], reach: float, loop: float) -> list[list[int]]:
    """Group two to four of the numbered ends that meet at a crossing, nearest first.

    Ends farther from each other than `reach` do not meet. Both ends of a segment meet only if it is longer
    than `loop`. Both are in metres.
    """
    count = len(ends.positions)
    distance = np.linalg.norm(ends.positions[:, None] - ends.positions[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    mates = np.arange(count) ^ 1
    short = ends.lengths <= loop
    distance[np.arange(count)[short], mates[short]] = np.inf
    distance[distance > reach] = np.inf
    nearest = np.argsort(distance, axis=1, kind="stable")

    def find_neighbors(end: int, taken: set[int]) -> list[int]:
        """Return the end and up to three that meet it, never both ends of a short segment."""
        group = [end]
        for other in nearest[end].tolist():
            if len(group) == 4 or not np.isfinite(distance[end, other]):
                break
            if other not in taken and not (short[other] and other ^ 1 in group):
                group.append(other)
        return group

    def rank(end: int) -> tuple[int, float]:
        group = find_neighbors(end, set(range(count)) - set(numbers))
        return -len(group), float(distance[end, group[1:]].sum())

    groups: list[list[int]] = []
    taken = set(range(count)) - set(numbers)
    for end in sorted(numbers, key=rank):
        if end not in taken:
            group = find_neighbors(end, taken)
            if len(group) > 1:
                groups.append(group)
                taken.update(group)
    return groups


def pair_ends(group: Sequence[int], directions: Array, min_agreement: float) -> list[tuple[int, int]]:
    """Join the ends of a group whose directions agree best: two pairs of four, one pair of two or three.

    `directions` point outward, so those of two ends that go on straight are opposite. A single pair is not
    joined if the cosine is below `min_agreement`.
    """
    agreement = -directions[list(group)] @ directions[list(group)].T
    if len(group) == 4:
        best = max(_PAIRINGS, key=lambda pairing: sum(agreement[a, b] for a, b in pairing))
        return [(group[a], group[b]) for a, b in best]
    a, b = max(combinations(range(len(group)), 2), key=lambda pair: agreement[pair])
    return [(group[a], group[b])] if agreement[a, b] >= min_agreement else []


@dataclass(frozen=True)
class SegmentJoins:
    """The joins that make strings of segments.

    Attributes
    ----------
    joins : tuple of (int, int)
        Pairs of ends that are joined.
    meeting : frozenset of int
        Ends that meet others, joined or not.
    """

    joins: tuple[tuple[int, int], ...]
    meeting: frozenset[int]


def reconnect(parts: Split, radius: float, ropes: int | None, config: Reconnection) -> SegmentJoins:
    """Reconnect segments at crossings (fig. 13).

    Ends are grouped by four, nearest first, and joined by direction in each group. The ends that are left
    are those of the ropes. If the number of ropes is known and more ends are left, the nearest ones whose
    directions agree are joined over a gap.
    """
    ends = find_ends(parts.segments, config.skip * radius, config.span * radius)
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
    return SegmentJoins(tuple(joins), frozenset(meeting))
