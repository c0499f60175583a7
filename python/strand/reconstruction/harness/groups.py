"""Hubs that are one place together, and the readings of all places that cost least in sum.

Thinning tears a crossing or a junction apart into several hubs. Each way to group neighboring hubs is tried.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strand.reconstruction.harness.lines import NO_HUB, Lines, measure_length
from strand.reconstruction.harness.parting import find_parting
from strand.reconstruction.harness.ports import Port, measure_port
from strand.reconstruction.harness.readings import Reading, list_readings, price_level
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_MAX_MIDDLE = 12.0  # length of the stretch that two crossing strands share at most, half widths
_MAX_TORN = 3.0  # distance of the hubs of one junction, half widths
_MAX_AROUND = 4.0  # length of each arc around a hole in one place, half widths
_MAX_HUBS = 4  # of one place
_MAX_CLUSTER = 9  # hubs that are decided together
_NARROWER = 0.7  # of the reach that puts hubs together, for clusters with more
_LAID_LEVEL = 2.5  # cost of a high stretch beside an end that lies on a strand at most
_ALIKE = 3.0  # costs over the least of groupings that make the same graph
_PRUNED = 6.0  # costs over the least that are no alternative


@dataclass(frozen=True, eq=False)
class Group:
    """Hubs that may be one place.

    Attributes
    ----------
    hubs : tuple of int
    inner : tuple of int
        The arcs between them.
    ports : list of Port
    at : list of int
        The hub of each port.
    middle : (2,) ndarray
        Row and column.
    readings : list of Reading
        The cheapest first.
    """

    hubs: tuple[int, ...]
    inner: tuple[int, ...]
    ports: list[Port]
    at: list[int]
    middle: Array
    readings: list[Reading]


@dataclass(frozen=True, eq=False)
class Place:
    """A group of hubs, and how it is read.

    Attributes
    ----------
    group : Group
    reading : Reading
    margin : float
        How much more all places cost together if this one is read otherwise; infinite if it cannot be.
    """

    group: Group
    reading: Reading
    margin: float


def list_layouts(
    lines: Lines, drawn: SurfaceMap, on_table: bool, most: int
) -> list[tuple[float, list[Place]]]:
    """Return the places and their readings that cost least together, and the next best graphs.

    Parameters
    ----------
    lines : Lines
    drawn : SurfaceMap
    on_table : bool
        Whether ropes lie on a table, so that a crossing rises above its surroundings.
    most : int
        How many graphs are returned at most.

    Returns
    -------
    list of (float, list of Place)
        The cost over the least, and the places; the cheapest first.
    """
    ends = [lines.list_ends(hub) for hub in range(len(lines.hubs))]
    ports = {end: measure_port(*end, lines, drawn) for at in ends for end in at}
    lengths = _measure_arcs(lines, drawn)
    layouts: list[tuple[float, list[Place]]] = [(0.0, [])]
    for hubs, reach in _list_clusters(lines, lengths, _MAX_MIDDLE, range(len(lines.hubs))):
        short = {
            number: length
            for number, length in lengths.items()
            if length <= reach and set(lines.arcs[number].hubs) <= set(hubs)
        }
        groups = [
            group
            for chosen in _list_connected(hubs, lines, short)
            if (group := _make_group(chosen, lines, drawn, ends, ports, short, on_table)) is not None
        ]
        levels = {
            number: _price_between(number, lines, drawn, ends, ports, on_table)
            for number in short
            if all(len(ends[hub]) == 3 for hub in lines.arcs[number].hubs)
        }
        solved = _solve(
            hubs, groups, {lines.arcs[number].hubs: cost for number, cost in levels.items()}, most
        )
        layouts = [(cost + more, [*places, *own]) for cost, places in layouts for more, own in solved]
        layouts = sorted(layouts, key=lambda layout: layout[0])[:most]
    return layouts


def _measure_arcs(lines: Lines, drawn: SurfaceMap) -> dict[int, float]:
    """Return the length of each arc between two hubs, in half widths at the hubs."""
    lengths = {}
    for number, arc in enumerate(lines.arcs):
        first, second = arc.hubs
        if NO_HUB not in arc.hubs and first != second:
            width = float(drawn.sample_widths(lines.hubs[[first, second]]).mean())
            lengths[number] = measure_length(arc.cells) / max(width, 1.0)
    return lengths


def _list_clusters(
    lines: Lines, lengths: dict[int, float], reach: float, hubs: Sequence[int]
) -> Iterator[tuple[list[int], float]]:
    """Yield hubs that arcs within reach connect, and the reach: less where they are too many."""
    left = set(hubs)
    while left:
        found, open_hubs = set(), [min(left)]
        while open_hubs:
            hub = open_hubs.pop()
            found.add(hub)
            for number, length in lengths.items():
                pair = lines.arcs[number].hubs
                if length <= reach and hub in pair:
                    open_hubs += [other for other in pair if other in left and other not in found]
        left -= found
        if len(found) > _MAX_CLUSTER:
            yield from _list_clusters(lines, lengths, _NARROWER * reach, sorted(found))
        else:
            yield sorted(found), reach


def _list_connected(hubs: Sequence[int], lines: Lines, short: dict[int, float]) -> Iterator[tuple[int, ...]]:
    """Yield sets of hubs that short arcs connect."""
    pairs = [set(lines.arcs[number].hubs) for number in short]
    for count in range(1, _MAX_HUBS + 1):
        for chosen in combinations(hubs, count):
            reached, more = {chosen[0]}, True
            while more:
                grown = reached.union(*(pair for pair in pairs if pair & reached and pair <= set(chosen)))
                more, reached = grown != reached, grown
            if len(reached) == count:
                yield chosen


def _make_group(
    hubs: tuple[int, ...],
    lines: Lines,
    drawn: SurfaceMap,
    ends: list[list[tuple[int, int]]],
    ports: dict[tuple[int, int], Port],
    short: dict[int, float],
    on_table: bool,
) -> Group | None:
    """Return hubs as one place; None if they cannot be one."""
    inner = tuple(number for number in short if set(lines.arcs[number].hubs) <= set(hubs))
    if len(inner) >= len(hubs) and max(short[number] for number in inner) > _MAX_AROUND:
        return None
    at = [(end, hub) for hub in hubs for end in ends[hub] if end[0] not in inner]
    own = [ports[end] for end, _ in at]
    torn = all(short[number] < _MAX_TORN for number in inner) and _meet_at_one(
        hubs, lines, drawn, ends, ports
    )
    cells = np.concatenate([lines.hubs[list(hubs)], *(lines.arcs[number].cells for number in inner)])
    readings = list_readings(own, [hub for _, hub in at], cells, drawn, on_table, torn)
    return Group(hubs, inner, own, [hub for _, hub in at], cells.mean(axis=0), readings) if readings else None


def _meet_at_one(
    hubs: Sequence[int],
    lines: Lines,
    drawn: SurfaceMap,
    ends: list[list[tuple[int, int]]],
    ports: dict[tuple[int, int], Port],
) -> bool:
    """Tell whether branches part at one place, though perhaps far back along the trunk."""
    places = [find_parting(lines.hubs[hub], [ports[end] for end in ends[hub]], lines, drawn) for hub in hubs]
    reach = _MAX_TORN * float(drawn.sample_widths(lines.hubs[list(hubs)]).max())
    for (hub, place), (other, there) in combinations(zip(hubs, places, strict=True), 2):
        way = lines.hubs[other] - lines.hubs[hub]
        # places that move past each other are one
        if float((there - place) @ way) > reach * float(np.linalg.norm(way)):
            return False
    return True


def _price_between(
    number: int,
    lines: Lines,
    drawn: SurfaceMap,
    ends: list[list[tuple[int, int]]],
    ports: dict[tuple[int, int], Port],
    on_table: bool,
) -> float:
    """Return what it costs that two hubs are junctions, by the height of the arc between them."""
    pair = lines.arcs[number].hubs
    at = [(end, hub) for hub in pair for end in ends[hub] if end[0] != number]
    own, hubs = [ports[end] for end, _ in at], [hub for _, hub in at]
    return price_level(own, hubs, lines.arcs[number].cells, drawn, on_table) if len(own) == 4 else 0.0


def _solve(
    hubs: Sequence[int], groups: Sequence[Group], levels: dict[tuple[int, int], float], most: int
) -> list[tuple[float, list[Place]]]:
    """Return the readings of groups, which hold each hub once, that cost least; the next graphs too."""
    solutions: list[tuple[float, list[tuple[int, int]]]] = []
    least = np.inf
    by_first: dict[int, list[int]] = {hub: [] for hub in hubs}
    for number, group in enumerate(groups):
        by_first[min(group.hubs)].append(number)

    def go_on(
        done: frozenset[int], chosen: list[tuple[int, int]], joined: dict[int, float], cost: float
    ) -> None:
        nonlocal least
        if cost > least + _PRUNED:
            return
        left = [hub for hub in hubs if hub not in done]
        if not left:
            least = min(least, cost)
            solutions.append((cost, chosen))
            return
        for number in by_first[left[0]]:
            group = groups[number]
            if done.intersection(group.hubs):
                continue
            for place, reading in enumerate(group.readings):
                own = _limit_levels(group, reading)
                now = joined | own
                more = reading.cost + sum(
                    min(level, now[a], now[b])
                    for (a, b), level in levels.items()
                    if a in now and b in now and (a in own) != (b in own)
                )
                go_on(done.union(group.hubs), [*chosen, (number, place)], now, cost + more)

    go_on(frozenset(), [], {}, 0.0)
    described = [
        (
            cost,
            chosen,
            _describe([(groups[number], groups[number].readings[place]) for number, place in chosen]),
        )
        for cost, chosen in sorted(solutions)
    ]
    found: list[tuple[float, list[Place]]] = []
    graphs: list[list[tuple[str, ...]]] = []
    for cost, _, graph in described:
        if graph in graphs or len(graphs) == most:
            continue
        graphs.append(graph)
        # the smallest places tell most closely where strands meet
        _, _, best = min(
            (sum(len(groups[number].inner) for number, _ in chosen), other, chosen)
            for other, chosen, own in described
            if own == graph and other < cost + _ALIKE
        )
        others = [(other - cost, set(chosen)) for other, chosen, own in described if own != graph]
        places = [
            Place(
                groups[number],
                groups[number].readings[place],
                min((more for more, chosen in others if (number, place) not in chosen), default=np.inf),
            )
            for number, place in best
        ]
        found.append((cost - described[0][0], places))
    return found


def _limit_levels(group: Group, reading: Reading) -> dict[int, float]:
    """Return the hubs where arcs are joined or end, and what a high stretch to the next one costs at most."""
    met = [group.at[port] for port in (reading.junction if reading.laid is None else range(3))]
    return {hub: np.inf if reading.laid is None else _LAID_LEVEL for hub in met if met.count(hub) > 1}


def _describe(places: Sequence[tuple[Group, Reading]]) -> list[tuple[str, ...]]:
    """Return which ends of strands are joined, alike for all groupings of hubs that make the same graph."""
    joined: dict[tuple[int, int], int] = {}
    onward: dict[tuple[int, int], tuple[int, int]] = {}
    laid: set[tuple[int, int]] = set()
    inner = {arc for group, _ in places for arc in group.inner}
    for number, (group, reading) in enumerate(places):
        ends = [(port.arc, port.end) for port in group.ports]
        for some, other in reading.pairs:
            onward[ends[some]], onward[ends[other]] = ends[other], ends[some]
        joined.update({ends[port]: number for port in reading.junction})
        if reading.laid is not None:
            laid.add(ends[reading.laid])
    arcs = {port.arc for group, _ in places for port in group.ports} - inner
    strands = []
    for start in sorted((arc, end) for arc in arcs for end in (0, 1)):
        if start in onward:
            continue
        stop, seen = (start[0], 1 - start[1]), {start[0]}
        while stop in onward and onward[stop][0] not in seen:
            arc, end = onward[stop]
            seen.add(arc)
            stop = (arc, 1 - end)
        strands.append((start, stop))
    names = {
        number: str(
            sorted(str(stop) for start, stop in strands if joined.get(start) == number and stop not in joined)
        )
        for number in set(joined.values())
    }

    def name(end: tuple[int, int]) -> str:
        return "laid" if end in laid else names[joined[end]] if end in joined else str(end)

    return sorted((name(start), name(stop)) for start, stop in strands)
