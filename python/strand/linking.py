"""Which arc goes on as which: one decision over all ends, by the cost of the curves that would join them."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import combinations

import numpy as np
import rustworkx as rx

from strand import _core
from strand.bridges import LONG, SEEN_THROUGH, bridge_cost, least_bending
from strand.config import Linking
from strand.hues import Hues
from strand.known import Known
from strand.strings import bridge
from strand.topology import end_direction, path_length, runs, walk
from strand.view import Array
from strand.visibility import Sight

# weights of the matching are whole numbers, in millionths of the cost
_UNIT = 1e6
# gaps shorter than this are looked at from a radius back too, in radii
_NEAR = 2.5
# gaps that no camera could see into may be longer by this factor; the share that counts as none of it
_UNSEEN, _MOSTLY = 1.7, 0.8
# no gap is bridged that was seen through on such a stretch, in radii and as a share of the gap
_THROUGH = 1.0, 0.3
# arcs shorter than this may be shadows of others that they are nearer to than strands in contact, in radii
_SHADOW, _BESIDE = 6.0, 1.75
# arcs shorter than this are stubs, in radii; an arc points at one within this angle, radians
_STUB, _AIM = 2.5, 0.5
# so many ways to bridge gaps are compared, and so many to do without rings
_WAYS, _RINGLESS = 20000, 500


def part_at_contacts(arcs: Sequence[Array], radius: float, config: Linking, back: float = 0.0) -> list[Array]:
    """Cut arcs where another's end lies inside them.

    Two strands cannot be in one place, so a trace took a wrong turn there.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.
    config : Linking
    back : float
        How far such an end is cut back too, as long as it is that near, in radii.

    Returns
    -------
    list of (K, 3) ndarray
        The arcs, without the nodes around contacts; pieces of fewer than three nodes are left out.
    """
    lengths = [path_length(arc) for arc in arcs]
    kept = [np.ones(len(arc), dtype=bool) for arc in arcs]
    half = config.contact_gap * radius
    for i, arc in enumerate(arcs):
        for end, place in ((arc[0], 0.0), (arc[-1], lengths[i][-1])):
            for j, other in enumerate(arcs):
                distance = np.linalg.norm(other - end, axis=1)
                if i == j:
                    distance[np.abs(lengths[j] - place) < 4.0 * radius] = np.inf
                nearest = int(distance.argmin())
                s = lengths[j]
                inside = half < s[nearest] < s[-1] - half
                if inside and distance[nearest] < config.contact * radius:
                    kept[j] &= np.abs(s - s[nearest]) > half
                    kept[i] &= ~_merged(arc, np.abs(lengths[i] - place), other, i == j, radius, back)
    pieces = []
    for arc, keep in zip(arcs, kept, strict=True):
        pieces += [arc[a:b] for a, b in runs(keep) if b - a >= 3]
    return pieces


def _merged(arc: Array, from_end: Array, other: Array, same: bool, radius: float, back: float) -> np.ndarray:
    """(M,) Nodes up to `back` radii from an arc's end that have not yet left another strand."""
    if back <= 0:
        return np.zeros(len(arc), dtype=bool)
    apart = np.linalg.norm(arc[:, None] - other[None], axis=2)
    if same:
        apart[np.abs(from_end[:, None] - from_end[None]) < 4.0 * radius + from_end[:, None]] = np.inf
    left = from_end[apart.min(axis=1) > 1.75 * radius]
    return np.asarray(from_end < min(float(left.min()) if len(left) else np.inf, back * radius))


def without_shadows(arcs: Sequence[Array], radius: float) -> list[Array]:
    """Leave out short arcs that run inside longer ones: two strands are two radii apart.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.

    Returns
    -------
    list of (M, 3) ndarray
    """
    lengths = [path_length(arc)[-1] for arc in arcs]
    kept = []
    for arc, length in zip(arcs, lengths, strict=True):
        longer = [other for other, its in zip(arcs, lengths, strict=True) if its > length]
        if length < _SHADOW * radius and longer:
            apart = np.linalg.norm(arc[:, None] - np.concatenate(longer)[None], axis=2).min(axis=1)
            if np.median(apart) < _BESIDE * radius:
                continue
        kept.append(arc)
    return kept


def aimed(arcs: Sequence[Array], radius: float) -> list[Array]:
    """Turn stubs whose direction is no better than chance into that of the arc that leads to them.

    What is seen of a string beyond a crossing near its end is about as long as wide; a tube fitted to it
    may lie across. The arc that points at it says how it runs: along the circle from its end to the stub's
    middle.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.

    Returns
    -------
    list of (M, 3) ndarray
        The arcs in their order, stubs turned.
    """
    lengths = [path_length(arc)[-1] for arc in arcs]
    ends = [
        (nodes[-1], end_direction(nodes, 0.0, 1.5 * radius))
        for arc, length in zip(arcs, lengths, strict=True)
        if length >= _STUB * radius
        for nodes in (arc[::-1], arc)
    ]
    turned = []
    for arc, length in zip(arcs, lengths, strict=True):
        middle = arc[len(arc) // 2]
        best, least = None, _AIM
        for end, leave in ends if length < _STUB * radius else []:
            step = middle - end
            gap = float(np.linalg.norm(step))
            if not 1.2 * radius < gap < 6.0 * radius:
                continue
            straight = step / gap
            angle = float(np.arccos(np.clip(leave @ straight, -1.0, 1.0)))
            if angle < least:
                best, least = 2.0 * (leave @ straight) * straight - leave, angle
        own = end_direction(arc, 0.0, length)
        if best is not None and abs(own @ best) < np.cos(_AIM):
            arc = middle + np.linspace(-0.5, 0.5, len(arc))[:, None] * length * best
        turned.append(arc)
    return turned


def join_cost(p: Array, leave: Array, q: Array, arrive: Array, radius: float) -> float:
    """Cost of the curve that leaves the end p along `leave` and meets the end q, which points along `arrive`.

    For a gap L bent by the angles a and b at its two ends it is 2 (a^2 + b^2), the bending energy of a cubic
    (8 r / L) (a^2 + b^2 - a b), and 0.25 L / r. Ends that touch or overlap cost their turn and their sideways
    offset. Infinite where the curve would have to turn back.
    """
    return _core.join_cost(p, leave, q, arrive, radius)


@dataclass(frozen=True, eq=False)
class Links:
    """What joining each pair of ends would cost: end 2k is the first node of arc k, 2k + 1 its last.

    Attributes
    ----------
    arcs : tuple of (M, 3) ndarray
        Ordered nodes, metres.
    costs : dict of (int, int) to float
        Of the pairs that are cheaper to join than to leave.
    rings : bool
        Whether joins may close rings.
    contrast : (E, E) ndarray or None
        What of each pair's cost is for the difference of their colours, if those are known.
    """

    arcs: tuple[Array, ...]
    costs: dict[tuple[int, int], float]
    rings: bool = True
    contrast: Array | None = None

    @classmethod
    def between(
        cls,
        arcs: Sequence[Array],
        radius: float,
        config: Linking,
        sight: Sight | None = None,
        hues: Hues | None = None,
    ) -> Links:
        """Price all joins by the curves that would make them, and by what the views saw along these.

        Parameters
        ----------
        arcs : sequence of (M, 3) ndarray
            Ordered nodes, metres.
        radius : float
            The strings' radius, metres.
        config : Linking
        sight : Sight, optional
            What the views saw; without it space that was seen empty costs nothing.
        hues : Hues, optional
            The pieces' colours, if they are known.
        """
        span = 1.5 * radius
        ends = [(nodes[-1], end_direction(nodes, 0.0, span)) for arc in arcs for nodes in (arc[::-1], arc)]
        back = [_end(nodes, radius, span) for arc in arcs for nodes in (arc[::-1], arc)]
        position = np.array([p for p, _ in ends]).reshape(-1, 3)
        distance = np.linalg.norm(position[:, None] - position[None], axis=2)
        # where nothing could have been seen, gaps may be longer
        farthest = config.gap * radius * (1.0 if sight is None else _UNSEEN)
        contrast = None if hues is None else hues.contrast(arcs, radius)
        costs: dict[tuple[int, int], float] = {}
        for i, j in zip(*np.nonzero(np.triu(distance <= farthest, k=1)), strict=True):
            i, j = int(i), int(j)
            ring = i ^ 1 == j
            if ring and (config.rings == "never" or path_length(arcs[i // 2])[-1] < config.loop * radius):
                continue
            (p, leave), (q, arrive) = ends[i], ends[j]
            cost = join_cost(p, leave, q, arrive, radius)
            if distance[i, j] < _NEAR * radius:
                # over a short gap the last nodes' noise turns the curve: look from a radius back too
                cost = min(cost, join_cost(*back[i], *back[j], radius))
            if contrast is not None:
                cost += float(contrast[i, j])
            if cost < 2.0 * config.free_end and sight is not None and distance[i, j] > 1.2 * radius:
                nodes = bridge(_outward(arcs, i), _outward(arcs, j)[::-1], span, 0.4 * radius)
                if distance[i, j] > config.gap * radius and sight.occluded(nodes, radius).mean() < _MOSTLY:
                    continue
                empty = sight.free(nodes, radius)
                longest = max((stop - start for start, stop in runs(empty)), default=0) * 0.4
                if longest >= max(_THROUGH[0], _THROUGH[1] * distance[i, j] / radius):
                    continue
                share = float(empty.mean()) if len(nodes) else 0.0
                cost += config.seen_through * share * distance[i, j] / radius
            if cost < 2.0 * config.free_end:
                costs[i, j] = cost
        return cls(tuple(arcs), costs, config.rings != "never", contrast)

    def matched(
        self, free_end: float, without: Collection[tuple[int, int]] = ()
    ) -> tuple[list[tuple[int, int]], float]:
        """Join ends by the matching of least cost.

        Parameters
        ----------
        free_end : float
            Cost of an end that is joined to none.
        without : collection of (int, int)
            Pairs that may not be joined.

        Returns
        -------
        joins : list of (int, int)
        cost : float
            Of all joins and free ends.
        """
        joins, cost = self._matched(free_end, without)
        if self.rings:
            return joins, cost
        # without rings: matchings that close one are parted by the first of its joins that they lack
        ways = [(cost, 0, joins, frozenset(without))]
        count = 0
        while True:
            cost, _, joins, barred = heappop(ways)
            rings = [entered for entered, closed in walk(len(self.arcs), joins) if closed]
            if not rings:
                return joins, cost
            arcs = {end // 2 for end in rings[0]}
            ring = [pair for pair in joins if pair[0] // 2 in arcs]
            ring.sort(key=self.costs.__getitem__, reverse=True)
            if count > _RINGLESS:
                ways, ring = [], ring[:1]
            for pair in ring:
                count += 1
                fewer = barred | {pair}
                joins, cost = self._matched(free_end, fewer)
                heappush(ways, (cost, count, joins, fewer))
                barred |= {other for other in self.costs if other != pair and not set(pair).isdisjoint(other)}

    def _matched(
        self, free_end: float, without: Collection[tuple[int, int]]
    ) -> tuple[list[tuple[int, int]], float]:
        """Join ends by the matching of least cost, rings or not."""
        graph = rx.PyGraph()
        graph.add_nodes_from(range(2 * len(self.arcs)))
        for pair, cost in self.costs.items():
            if cost < 2.0 * free_end and pair not in without:
                graph.add_edge(*pair, round((2.0 * free_end - cost) * _UNIT))
        joins = sorted((min(pair), max(pair)) for pair in rx.max_weight_matching(graph, weight_fn=int))
        free = 2 * (len(self.arcs) - len(joins))
        return joins, sum(self.costs[pair] for pair in joins) + free * free_end

    def bridged(
        self,
        joins: Sequence[tuple[int, int]],
        pieces: Sequence[int],
        ropes: int,
        radius: float,
        config: Linking,
        sight: Sight | None,
        without: Collection[tuple[int, int]] = (),
    ) -> list[tuple[int, int]]:
        """Join chains over gaps of any length until so many are left.

        Parameters
        ----------
        joins : sequence of (int, int)
            Pairs of ends that are joined already.
        pieces : sequence of int
            For each arc the number of its chain; -1 for those that are left out.
        ropes : int
            How many chains to leave.
        radius : float
            The strings' radius, metres.
        config : Linking
        sight : Sight, optional
            What the views saw.
        without : collection of (int, int)
            Pairs that may not be joined.

        Returns
        -------
        list of (int, int)
            The joins and those that cost least together, none of which closes a ring or leads through what
            cameras saw to be empty; so more chains may be left.
        """
        free = self._free(joins, pieces)
        count = len({number for number in pieces if number >= 0})
        pairs = (
            (i, j)
            for i, j in combinations(free, 2)
            if pieces[i // 2] != pieces[j // 2] and (i, j) not in without
        )
        priced = self._priced(pairs, radius, config, sight)
        more: list[tuple[int, int]] = []
        wanted = count - ropes
        while wanted > 0 and not more:
            more = _cheapest(priced, pieces, wanted)
            wanted -= 1
        return [*joins, *more]

    def closed(
        self,
        joins: Sequence[tuple[int, int]],
        pieces: Sequence[int],
        apart: bool,
        radius: float,
        config: Linking,
        sight: Sight | None,
    ) -> list[tuple[int, int]]:
        """Join the ends of chains that are left to rings, over gaps of any length.

        Parameters
        ----------
        joins : sequence of (int, int)
            Pairs of ends that are joined already.
        pieces : sequence of int
            For each arc the number of its chain; -1 for those that are left out.
        apart : bool
            Whether each chain is a ring of its own; else rings may be made of several.
        radius : float
            The strings' radius, metres.
        config : Linking
        sight : Sight, optional
            What the views saw.

        Returns
        -------
        list of (int, int)
            The joins and as many as can be, those that cost least together, none of which leads through what
            cameras saw to be empty; so some chains may stay open.
        """
        pairs = (
            (i, j)
            for i, j in combinations(self._free(joins, pieces), 2)
            if not apart or pieces[i // 2] == pieces[j // 2]
        )
        priced = self._priced(pairs, radius, config, sight)
        graph = rx.PyGraph()
        graph.add_nodes_from(range(2 * len(self.arcs)))
        most = max((cost for cost, _, _ in priced), default=0.0)
        graph.add_edges_from([(i, j, round((most - cost) * _UNIT)) for cost, i, j in priced])
        more = rx.max_weight_matching(graph, max_cardinality=True, weight_fn=int)
        return [*joins, *sorted((min(pair), max(pair)) for pair in more)]

    def _free(self, joins: Sequence[tuple[int, int]], pieces: Sequence[int]) -> list[int]:
        """Return the ends of chains that are not joined."""
        taken = {end for pair in joins for end in pair}
        return [end for end in range(2 * len(self.arcs)) if end not in taken and pieces[end // 2] >= 0]

    def _priced(
        self, pairs: Iterable[tuple[int, int]], radius: float, config: Linking, sight: Sight | None
    ) -> list[tuple[float, int, int]]:
        """Cost of bridging a gap of any length between two ends, cheapest first.

        Pairs whose bridge leads through what cameras saw to be empty are left out.
        """
        priced = []
        for i, j in pairs:
            before, after = _outward(self.arcs, i), _outward(self.arcs, j)[::-1]
            nodes = least_bending(before, after, radius, sight, config)
            gap = float(np.linalg.norm(after[0] - before[-1]))
            way = np.vstack([before[-1:], nodes, after[:1]])
            if sight is not None and sight.free(way, radius).mean() > SEEN_THROUGH:
                continue
            turn = 4.0 - 2.0 * (
                end_direction(before, 0.0, 1.5 * radius) - end_direction(after[::-1], 0.0, 1.5 * radius)
            ) @ (after[0] - before[-1]) / max(gap, 1e-12)
            cost = 8.0 * bridge_cost(way, radius, sight, config) + turn + 0.25 * gap / radius
            if self.contrast is not None:
                cost += self.contrast[i, j]
            priced.append((float(cost), i, j))
        return sorted(priced)

    def end(self, number: int) -> Array:
        """(3,) Where an end lies, metres."""
        return np.asarray(self.arcs[number // 2][-1 if number % 2 else 0])

    def joined(
        self,
        joins: Sequence[tuple[int, int]],
        radius: float,
        config: Linking,
        sight: Sight | None,
        known: Known | None = None,
    ) -> list[tuple[Array, bool]]:
        """Make chains of arcs.

        Parameters
        ----------
        joins : sequence of (int, int)
            Pairs of ends.
        radius : float
            The strings' radius, metres.
        config : Linking
        sight : Sight, optional
            What the views saw: bridges keep to what they did not see.
        known : Known, optional
            Of strings whose lengths it says, bridges over long gaps are as long as what was seen leaves.

        Returns
        -------
        list of ((K, 3) ndarray, bool)
            Nodes of each chain in order, metres, with cubics over the gaps, and whether it closes on itself:
            then its last node is its first again.
        """
        strings = [
            ([self.arcs[end // 2][:: -1 if end % 2 else 1] for end in entered], closed)
            for entered, closed in walk(len(self.arcs), joins)
        ]
        wanted = None if known is None or not known.lengths else 1.0
        made = [_strung(parts, closed, radius, config, sight, wanted) for parts, closed in strings]
        if known is not None and known.lengths:
            lengths = [float(path_length(nodes)[-1]) for nodes, _ in made]
            for k, true in enumerate(known.expected(lengths)):
                _, gaps = made[k]
                if true is not None and gaps > 0 and true > lengths[k]:
                    stretch = 1.0 + (true - lengths[k]) / gaps
                    made[k] = _strung(*strings[k], radius, config, sight, stretch, known.bounds)
        return [(nodes, closed) for (nodes, _), (_, closed) in zip(made, strings, strict=True)]


def _cheapest(
    priced: Sequence[tuple[float, int, int]], pieces: Sequence[int], wanted: int
) -> list[tuple[int, int]]:
    """Return the `wanted` pairs, dearer ones later, that cost least together and join ever other chains."""
    best: tuple[float, list[tuple[int, int]]] = (np.inf, [])
    ways = 0

    def search(first: int, chosen: list[tuple[int, int]], cost: float, group: dict[int, int]) -> None:
        nonlocal best, ways
        left = wanted - len(chosen)
        if left <= 0:
            best = min(best, (cost, list(chosen)), key=lambda way: way[0])
            return
        for k in range(first, len(priced) - left + 1):
            more, i, j = priced[k]
            ways += 1
            # what is to come is not cheaper
            if cost + left * more >= best[0] or (ways > _WAYS and best[1]):
                return
            a, b = group[pieces[i // 2]], group[pieces[j // 2]]
            if a == b or any(end in pair for pair in chosen for end in (i, j)):
                continue
            merged = {piece: a if number == b else number for piece, number in group.items()}
            search(k + 1, [*chosen, (i, j)], cost + more, merged)

    search(0, [], 0.0, {number: number for number in pieces})
    return [(min(pair), max(pair)) for pair in best[1]]


def _end(nodes: Array, skip: float, span: float) -> tuple[Array, Array]:
    """Place a stretch before the last node, and the direction there."""
    s = path_length(nodes)
    at = int(np.searchsorted(s, max(s[-1] - skip, 0.5 * s[-1])))
    return nodes[at], end_direction(nodes[: at + 1], 0.0, span)


def _outward(arcs: Sequence[Array], end: int) -> Array:
    """Nodes of an arc in the order in which they lead to one of its ends."""
    return arcs[end // 2][:: 1 if end % 2 else -1]


def link(
    arcs: Sequence[Array], radius: float, config: Linking, sight: Sight | None = None
) -> list[tuple[Array, bool]]:
    """Join arcs to chains by the matching of all their ends that costs least.

    Parameters
    ----------
    arcs : sequence of (M, 3) ndarray
        Ordered nodes, metres.
    radius : float
        The strings' radius, metres.
    config : Linking
    sight : Sight, optional
        What the views saw.

    Returns
    -------
    list of ((K, 3) ndarray, bool)
        As `Links.joined`.
    """
    links = Links.between(arcs, radius, config, sight)
    return links.joined(links.matched(config.free_end)[0], radius, config, sight)


def _cut_back(nodes: Array, other: Array, radius: float) -> Array:
    """Drop up to six last nodes that are nearer than 1.5 radii to a place; four are always left."""
    near = np.linalg.norm(nodes[-6:] - other, axis=1) < 1.5 * radius
    count = len(near) if near.all() else len(near) - (int(np.flatnonzero(~near)[-1]) + 1)
    return nodes[: max(len(nodes) - count, min(len(nodes), 4))]


def _strung(
    parts: Sequence[Array],
    closed: bool,
    radius: float,
    config: Linking,
    sight: Sight | None,
    stretch: float | None,
    bounds: tuple[Array, Array] | None = None,
) -> tuple[Array, float]:
    """One chain of several parts, and how long its bridges are that could be longer.

    Parts are cut back where they overlap, with a cubic between; long ones are made longer by `stretch`,
    without which they are not measured.
    """
    longer = 0.0

    def bridged(before: Array, after: Array, nodes: Array) -> Array:
        nonlocal longer
        if stretch is None:
            return nodes
        way = np.vstack([before[-1:], nodes, after[:1]])
        length = float(path_length(way)[-1])
        seen_through = sight is not None and sight.free(way, radius).mean() > SEEN_THROUGH
        if length < LONG * radius or seen_through:
            return nodes
        longer += length
        if stretch == 1.0:
            return nodes
        return least_bending(before, after, radius, sight, config, stretch * length, bounds)

    nodes = parts[0]
    for part in parts[1:]:
        before = _cut_back(nodes, part[0], radius)
        after = _cut_back(part[::-1], before[-1], radius)[::-1]
        between = bridged(before, after, least_bending(before, after, radius, sight, config))
        nodes = np.vstack([before, between, after])
    if closed:
        nodes = _cut_back(nodes, nodes[0], radius)
        between = bridged(nodes, nodes, bridge(nodes, nodes, 1.5 * radius, 0.4 * radius))
        nodes = np.vstack([nodes, between, nodes[:1]])
    return nodes, longer
