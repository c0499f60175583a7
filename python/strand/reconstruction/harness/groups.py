"""Hubs that are one place together, and the readings of all places that cost least in sum.

Thinning tears a crossing or a junction apart into several hubs. Each way to group neighboring hubs is tried.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from strand.reconstruction.harness.lines import NO_HUB, End, Lines, measure_length
from strand.reconstruction.harness.parting import find_parting
from strand.reconstruction.harness.ports import Port, measure_port
from strand.reconstruction.harness.readings import Reading, list_readings, price_level
from strand.reconstruction.harness.surface_map import SurfaceMap
from strand.support.checks import Array

_MAX_MIDDLE = 12.0  # length of the stretch that two crossing strands share at most, half widths
_MAX_TORN = 3.0  # distance of the hubs of one junction, half widths
_MAX_TIED = 5.0  # length of the stretch along which one tie holds two strands at most, half widths
_FEWEST_CELLS = 3  # of such a stretch
_TOP = 95.0  # percentile of the heights along it that is the tie's
_TIE = 0.2  # height of a tie over the strands at least, radii
_MAX_AROUND = 4.0  # length of each arc around a hole in one place, half widths
_MAX_HUBS = 4  # of one place
_MAX_CLUSTER = 9  # hubs that are decided together
_NARROWER = 0.7  # of the reach that puts hubs together, for clusters with more
_LAID_LEVEL = 2.5  # cost of a high stretch beside an end that lies on a strand at most
_UNDER_LEVEL = 6.0  # the same beside one that lies under it: on its other side, the strand may go on
_SHORT_ARC = 1.6  # length of an arc below which its ends may be one junction, half widths
_SHORT_COST = 3.0  # cost of two junctions at one place
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

    @property
    def ends(self) -> list[End]:
        """The arc's end at each port."""
        return [(port.arc, port.end) for port in self.ports]


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
    lines: Lines, drawn: SurfaceMap, floor: float | None, most: int
) -> list[tuple[float, list[Place]]]:
    """Return the places and their readings that cost least together, and the next best graphs.

    Parameters
    ----------
    lines : Lines
    drawn : SurfaceMap
    floor : float or None
        Height of the table, metres; a crossing rises above its surroundings there. None without a table.
    most : int
        How many graphs are returned at most.

    Returns
    -------
    list of (float, list of Place)
        The cost over the least, and the places; the cheapest first.
    """
    survey = _survey_hubs(lines, drawn, floor)
    layouts: list[tuple[float, list[Place]]] = [(0.0, [])]
    for hubs, reach in _list_clusters(survey, _MAX_MIDDLE, range(len(lines.hubs))):
        short = survey.list_short(hubs, reach)
        made = (_make_group(chosen, survey, short) for chosen in _list_connected(hubs, survey, short))
        levels = {
            lines.arcs[number].hubs: _price_between(number, survey)
            for number in short
            if all(len(survey.ends[hub]) == 3 for hub in lines.arcs[number].hubs)
        }
        solved = _solve(hubs, [group for group in made if group is not None], levels, most)
        layouts = [(cost + more, [*places, *own]) for cost, places in layouts for more, own in solved]
        layouts = sorted(layouts, key=lambda layout: layout[0])[:most]
    return layouts


@dataclass(frozen=True, eq=False)
class _Survey:
    """All hubs of a map, and the arcs at them.

    Attributes
    ----------
    lines : Lines
    drawn : SurfaceMap
    floor : float or None
        Height of the table, metres.
    ends : list of list of End
        Those at each hub.
    ports : dict of End to Port
    lengths : dict of int to float
        The length of each arc between two hubs, in half widths at the hubs.
    """

    lines: Lines
    drawn: SurfaceMap
    floor: float | None
    ends: list[list[End]]
    ports: dict[End, Port]
    lengths: dict[int, float]

    @property
    def on_table(self) -> bool:
        """Whether ropes lie on a table."""
        return self.floor is not None

    def list_short(self, hubs: Collection[int], reach: float) -> list[int]:
        """Return the arcs between some hubs that are no longer than a reach."""
        return [
            number
            for number, length in self.lengths.items()
            if length <= reach and set(self.lines.arcs[number].hubs) <= set(hubs)
        ]


def _survey_hubs(lines: Lines, drawn: SurfaceMap, floor: float | None) -> _Survey:
    """Measure the ports of all hubs, and the arcs between them."""
    ends = [lines.list_ends(hub) for hub in range(len(lines.hubs))]
    ports = {end: measure_port(*end, lines, drawn, floor) for own in ends for end in own}
    lengths = {}
    for number, arc in enumerate(lines.arcs):
        first, second = arc.hubs
        if NO_HUB not in arc.hubs and first != second:
            width = float(drawn.sample_widths(lines.hubs[[first, second]]).mean())
            lengths[number] = measure_length(arc.cells) / max(width, 1.0)
    return _Survey(lines, drawn, floor, ends, ports, lengths)


def _list_clusters(survey: _Survey, reach: float, hubs: Collection[int]) -> Iterator[tuple[list[int], float]]:
    """Yield hubs that arcs within reach connect, and the reach: less where they are too many."""
    pairs = [survey.lines.arcs[number].hubs for number in survey.list_short(hubs, reach)]
    left = set(hubs)
    while left:
        found, open_hubs = set(), [min(left)]
        while open_hubs:
            hub = open_hubs.pop()
            found.add(hub)
            open_hubs += [other for pair in pairs if hub in pair for other in pair if other not in found]
        left -= found
        if len(found) > _MAX_CLUSTER:
            yield from _list_clusters(survey, _NARROWER * reach, sorted(found))
        else:
            yield sorted(found), reach


def _list_connected(hubs: Sequence[int], survey: _Survey, short: Sequence[int]) -> Iterator[tuple[int, ...]]:
    """Yield sets of hubs that short arcs connect."""
    pairs = [set(survey.lines.arcs[number].hubs) for number in short]
    for count in range(1, _MAX_HUBS + 1):
        for chosen in combinations(hubs, count):
            reached, more = {chosen[0]}, True
            while more:
                grown = reached.union(*(pair for pair in pairs if pair & reached and pair <= set(chosen)))
                more, reached = grown != reached, grown
            if len(reached) == count:
                yield chosen


def _make_group(hubs: tuple[int, ...], survey: _Survey, short: Sequence[int]) -> Group | None:
    """Return hubs as one place; None if they cannot be one."""
    lines = survey.lines
    inner = tuple(number for number in short if set(lines.arcs[number].hubs) <= set(hubs))
    lengths = [survey.lengths[number] for number in inner]
    if len(inner) >= len(hubs) and max(lengths) > _MAX_AROUND:
        return None
    ports, at = _list_ports(hubs, inner, survey)
    torn = all(length < _MAX_TORN for length in lengths) and _meet_at_one(hubs, survey)
    cells = np.concatenate([lines.hubs[list(hubs)], *(lines.arcs[number].cells for number in inner)])
    tie = _find_holding_tie(inner, ports, survey)
    readings = list_readings(ports, at, cells, survey.drawn, survey.on_table, torn, tie)
    return Group(hubs, inner, ports, at, cells.mean(axis=0), readings) if readings else None


def _list_ports(
    hubs: Collection[int], inner: Collection[int], survey: _Survey
) -> tuple[list[Port], list[int]]:
    """Return the ports of hubs but those of the arcs between them, and the hub of each."""
    at = [(end, hub) for hub in hubs for end in survey.ends[hub] if end[0] not in inner]
    return [survey.ports[end] for end, _ in at], [hub for _, hub in at]


def _find_holding_tie(inner: Sequence[int], ports: Sequence[Port], survey: _Survey) -> Array | None:
    """Return the cell of a tie that holds two strands together, which lie side by side along a short arc."""
    if survey.floor is None or len(inner) != 1 or len(ports) != 4 or survey.lengths[inner[0]] > _MAX_TIED:
        return None
    drawn, cells = survey.drawn, survey.lines.arcs[inner[0]].cells
    if len(cells) < _FEWEST_CELLS or not survey.ports[inner[0], 0].is_flat:
        return None
    _, backs = drawn.sample_backs(cells, float(np.median(drawn.sample_widths(cells))))
    radius = drawn.cell * float(np.mean([port.half_width for port in ports]))
    top, rest = float(np.percentile(backs, _TOP)), max(port.rest for port in ports)
    if top - rest < _TIE * radius:
        return None
    return np.asarray(cells[backs > 0.5 * (top + rest)].mean(axis=0))


def _meet_at_one(hubs: Sequence[int], survey: _Survey) -> bool:
    """Tell whether branches part at one place, though perhaps far back along the trunk."""
    lines, drawn = survey.lines, survey.drawn
    places = [
        find_parting(lines.hubs[hub], [survey.ports[end] for end in survey.ends[hub]], lines, drawn)
        for hub in hubs
    ]
    reach = _MAX_TORN * float(drawn.sample_widths(lines.hubs[list(hubs)]).max())
    for (hub, place), (other, there) in combinations(zip(hubs, places, strict=True), 2):
        way = lines.hubs[other] - lines.hubs[hub]
        # places that move past each other are one
        if float((there - place) @ way) > reach * float(np.linalg.norm(way)):
            return False
    return True


def _price_between(number: int, survey: _Survey) -> float:
    """Return what it costs that two hubs are junctions, by the height and length of the arc between them."""
    arc = survey.lines.arcs[number]
    ports, at = _list_ports(arc.hubs, (number,), survey)
    short = max(1.0 - survey.lengths[number] / _SHORT_ARC, 0.0)
    return price_level(ports, at, arc.cells, survey.drawn, survey.on_table) + _SHORT_COST * short


def _solve(
    hubs: Sequence[int], groups: Sequence[Group], levels: dict[tuple[int, int], float], most: int
) -> list[tuple[float, list[Place]]]:
    """Return the readings of groups, which hold each hub once, that cost least; the next graphs too."""
    options = [(group, reading) for group in groups for reading in group.readings]
    by_first: dict[int, list[int]] = {hub: [] for hub in hubs}
    for number, (group, _) in enumerate(options):
        by_first[min(group.hubs)].append(number)
    solutions = _search(hubs, options, by_first, levels)
    described = [
        (cost, chosen, _describe([options[number] for number in chosen]))
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
            (sum(len(options[number][0].inner) for number in chosen), other, chosen)
            for other, chosen, own in described
            if own == graph and other < cost + _ALIKE
        )
        others = [(other - cost, chosen) for other, chosen, own in described if own != graph]
        places = [
            Place(
                *options[number],
                min((more for more, chosen in others if number not in chosen), default=np.inf),
            )
            for number in best
        ]
        found.append((cost - described[0][0], places))
    return found


def _search(
    hubs: Sequence[int],
    options: Sequence[tuple[Group, Reading]],
    by_first: dict[int, list[int]],
    levels: dict[tuple[int, int], float],
) -> list[tuple[float, list[int]]]:
    """Return costs and numbers of options that hold each hub once, but those that cost much more."""
    solutions: list[tuple[float, list[int]]] = []
    least = np.inf

    def go_on(done: frozenset[int], chosen: list[int], joined: dict[int, float], cost: float) -> None:
        nonlocal least
        if cost > least + _PRUNED:
            return
        left = [hub for hub in hubs if hub not in done]
        if not left:
            least = min(least, cost)
            solutions.append((cost, chosen))
            return
        for number in by_first[left[0]]:
            group, reading = options[number]
            if done.intersection(group.hubs):
                continue
            own = _limit_levels(group, reading)
            now = joined | own
            more = reading.cost + sum(
                min(level, now[a], now[b])
                for (a, b), level in levels.items()
                if a in now and b in now and (a in own) != (b in own)
            )
            go_on(done.union(group.hubs), [*chosen, number], now, cost + more)

    go_on(frozenset(), [], {}, 0.0)
    return solutions


def _limit_levels(group: Group, reading: Reading) -> dict[int, float]:
    """Return the hubs where arcs are joined or end, and what a high stretch to the next one costs at most."""
    met = [group.at[port] for port in (reading.junction if reading.laid is None else range(3))]
    most = np.inf
    if reading.laid is not None:
        most = _UNDER_LEVEL if reading.under else _LAID_LEVEL
    return {hub: most for hub in met if met.count(hub) > 1}


def _describe(places: Sequence[tuple[Group, Reading]]) -> list[tuple[str, ...]]:
    """Return which ends of strands are joined, alike for all groupings of hubs that make the same graph."""
    joined: dict[End, int] = {}
    onward: dict[End, End] = {}
    laid: set[End] = set()
    inner = {arc for group, _ in places for arc in group.inner}
    for number, (group, reading) in enumerate(places):
        ends = group.ends
        for some, other in reading.pairs:
            onward[ends[some]], onward[ends[other]] = ends[other], ends[some]
        joined.update({ends[port]: number for port in reading.junction})
        if reading.laid is not None:
            laid.add(ends[reading.laid])
    arcs = {arc for group, _ in places for arc, _ in group.ends} - inner
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

    def name(end: End) -> str:
        return "laid" if end in laid else names[joined[end]] if end in joined else str(end)

    return sorted((name(start), name(stop)) for start, stop in strands)
