"""Match a found graph with a netlist: the naming of nodes with the least cost, and the next best one.

Both graphs become runs between ends and junctions: nodes of two edges are passed over. A match is an
isomorphism of runs. Where there is none, or a poor one, runs are taken out, the fewest first: of the netlist
(they are missing) or of the found graph (they are too many). Lengths give the cost of a match: half the
squared error in standard deviations, and linear beyond three. Branch and bound finds the best naming and the
next; a limit on its work bounds the time.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from strand.ropes.netlist import EdgeMatch, Netlist, NetMatch
from strand.support.checks import Array

OPEN = 3.0
"""Margin below which two namings count as equally good."""

_EDIT = 12.0  # cost of a run that is missing or too many
_WIRES = 3.0  # cost of another number of wires
_LINEAR = 3.0  # standard deviations beyond which the cost of a length grows linearly
_MAX_EDITS = 3  # runs that are missing or too many, together
_MAX_WORK = 200_000  # steps of the search
_MAX_NAMINGS = 1000  # namings kept


class Run(NamedTuple):
    """Edges in a row between two nodes that have not two edges."""

    a: int
    b: int
    length: float  # metres
    radius: float  # metres
    wires: int | None
    parts: tuple[int, ...]  # numbers of the edges from a to b
    between: tuple[int, ...]  # numbers of the nodes that they pass


@dataclass
class _Search:
    """The best namings so far, and the work that is left."""

    tolerance: float
    work: int = _MAX_WORK
    found: dict[tuple[tuple[int, int], ...], tuple[float, _Variant]] = field(default_factory=dict)
    bound: float = math.inf

    def keep(self, cost: float, naming: dict[int, int], variant: _Variant) -> None:
        """Keep a naming if it is better than what its nodes had, and lower the bound."""
        key = tuple(sorted(naming.items()))
        if key in self.found and self.found[key][0] <= cost:
            return
        if key in self.found or len(self.found) < _MAX_NAMINGS:
            self.found[key] = cost, variant
        costs = sorted(cost for cost, _ in self.found.values())
        if len(costs) > 1:
            self.bound = max(costs[1], costs[0] + OPEN)


@dataclass(frozen=True)
class _Variant:
    """Runs of both graphs, and the edges taken out of each; once matched, pairs of runs."""

    net: tuple[Run, ...]
    found: tuple[Run, ...]
    missing: frozenset[int] = frozenset()
    extra: frozenset[int] = frozenset()
    edits: int = 0
    pairs: tuple[tuple[int, int], ...] = ()


def match_netlist(
    net: Netlist, found: Sequence[tuple[int, int, float, float, int | None]], tolerance: float
) -> NetMatch:
    """Return the best match of found edges (start, stop, length, radius, wires) with a netlist."""
    place = {name: number for number, name in enumerate(net.nodes)}
    wanted = [
        Run(place[edge.start], place[edge.stop], edge.length, 0.0, edge.wires, (i,), ())
        for i, edge in enumerate(net.edges)
    ]
    given = [Run(*edge, (i,), ()) for i, edge in enumerate(found)]
    search = _Search(tolerance)
    level = [_Variant(contract(wanted), contract(given))]
    for edits in range(_MAX_EDITS + 1):
        if _EDIT * edits >= search.bound:
            break
        for variant in level:
            search.work -= len(variant.net) + len(variant.found)
            if search.work < 0:
                break
            _match_runs(variant, search)
        if edits < _MAX_EDITS and _EDIT * (edits + 1) < search.bound:
            level = _take_out(level, search)
    return _describe(net, found, search)


def contract(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Return the runs of a graph without nodes that only two different ones meet at."""
    left = dict(enumerate(runs))
    at: dict[int, list[int]] = {}
    for number, run in left.items():
        for end in (run.a, run.b):
            at.setdefault(end, []).append(number)
    for node in sorted(at):
        if len(at[node]) != 2 or at[node][0] == at[node][1]:
            continue
        one, other = at[node]
        first, second = left.pop(one), left.pop(other)
        first = first if first.b == node else _turn(first)
        second = second if second.a == node else _turn(second)
        merged = Run(
            first.a,
            second.b,
            first.length + second.length,
            max(first.radius, second.radius),
            first.wires if first.wires == second.wires else None,
            first.parts + second.parts,
            (*first.between, node, *second.between),
        )
        left[one] = merged
        at[node] = []
        at[merged.b][at[merged.b].index(other)] = one
    return tuple(left[number] for number in sorted(left))


def _turn(run: Run) -> Run:
    return run._replace(a=run.b, b=run.a, parts=run.parts[::-1], between=run.between[::-1])


def _take_out(level: Sequence[_Variant], search: _Search) -> list[_Variant]:
    """Return the variants with one run less in either graph."""
    made: dict[tuple[frozenset[int], frozenset[int]], _Variant] = {}
    for variant in level:
        for side, gone in (("net", "missing"), ("found", "extra")):
            runs: tuple[Run, ...] = getattr(variant, side)
            for number, run in enumerate(runs):
                search.work -= len(runs) // 8 + 1
                if search.work < 0:
                    return list(made.values())
                rest = runs[:number] + runs[number + 1 :]
                out = getattr(variant, gone) | set(run.parts)
                key = (out, variant.extra) if gone == "missing" else (variant.missing, out)
                if rest and key not in made and _hang_together(rest):
                    made[key] = replace(
                        variant, **{side: contract(rest), gone: out, "edits": variant.edits + 1}
                    )
    return list(made.values())


def _hang_together(runs: Sequence[Run]) -> bool:
    """Tell whether runs are one graph."""
    names = {end: end for run in runs for end in (run.a, run.b)}

    def find(node: int) -> int:
        while names[node] != node:
            names[node] = names[names[node]]
            node = names[node]
        return node

    for run in runs:
        names[find(run.a)] = find(run.b)
    return len({find(node) for node in names}) == 1


def _count_degrees(runs: Sequence[Run]) -> Counter[int]:
    return Counter(end for run in runs for end in (run.a, run.b))


def _find_costs(variant: _Variant, tolerance: float) -> Array:
    """Return the (N, N) costs of taking each run of the netlist for each found one."""
    wanted, found = (np.array([run.length for run in runs]) for runs in (variant.net, variant.found))
    radius = np.array([run.radius for run in variant.found])
    deviation = np.sqrt((tolerance * wanted[:, None]) ** 2 + 2.0 * radius**2)
    error = np.abs(wanted[:, None] - found) / deviation
    costs = np.where(error < _LINEAR, 0.5 * error**2, _LINEAR * error - 0.5 * _LINEAR**2)
    for i, run in enumerate(variant.net):
        for j, other in enumerate(variant.found):
            if None not in (run.wires, other.wires) and run.wires != other.wires:
                costs[i, j] += _WIRES
    return np.asarray(costs)


def _match_runs(variant: _Variant, search: _Search) -> None:
    """Search the isomorphisms of both graphs, and keep their namings."""
    degrees, found_degrees = _count_degrees(variant.net), _count_degrees(variant.found)
    if len(variant.net) != len(variant.found) or sorted(degrees.values()) != sorted(found_degrees.values()):
        return
    costs = _find_costs(variant, search.tolerance)
    rare = Counter(degrees.values())
    root = min(degrees, key=lambda node: (rare[degrees[node]], -degrees[node], node))
    order = _order_runs(variant.net, root)
    # no match of the runs that are left costs less
    least = costs.min(axis=1)[[number for number, _ in order]]
    rest = np.append(np.cumsum(least[::-1])[::-1], 0.0).tolist()
    table = costs.tolist()
    at: dict[int, list[tuple[int, int]]] = {node: [] for node in found_degrees}
    for number, run in enumerate(variant.found):
        at[run.a].append((number, run.b))
        if run.a != run.b:
            at[run.b].append((number, run.a))
    ends = [
        (number, run.a, run.b) if forward else (number, run.b, run.a)
        for number, forward in order
        for run in (variant.net[number],)
    ]
    naming: dict[int, int] = {}
    taken: set[int] = set()
    used: list[tuple[int, int]] = []
    used_found: set[int] = set()

    def extend(step: int, cost: float) -> None:
        if step == len(ends):
            search.keep(cost, naming, replace(variant, pairs=tuple(used)))
            return
        number, here, there = ends[step]
        known = naming.get(there)
        choices = sorted(
            (table[number][j], j, far)
            for j, far in at[naming[here]]
            if j not in used_found
            and (far == known if known is not None else far not in taken)
            and found_degrees[far] == degrees[there]
        )
        for more, j, far in choices:
            search.work -= 1
            if cost + more + rest[step + 1] >= search.bound or search.work < 0:
                return
            if known is None:
                naming[there] = far
                taken.add(far)
            used.append((number, j))
            used_found.add(j)
            extend(step + 1, cost + more)
            used.pop()
            used_found.discard(j)
            if known is None:
                del naming[there]
                taken.discard(far)

    for start in sorted(found_degrees):
        if found_degrees[start] == degrees[root]:
            naming[root] = start
            taken.add(start)
            extend(0, _EDIT * variant.edits)
            naming.clear()
            taken.clear()


def _order_runs(runs: Sequence[Run], root: int) -> list[tuple[int, bool]]:
    """Return the numbers of runs so that each starts at a node that was reached, and whether it does at a."""
    at: dict[int, list[int]] = {}
    for number, run in enumerate(runs):
        for end in (run.a, run.b):
            at.setdefault(end, []).append(number)
    order: list[tuple[int, bool]] = []
    seen, done, todo = {root}, set(), [root]
    while todo:
        node = todo.pop(0)
        for number in at[node]:
            if number in done:
                continue
            done.add(number)
            run = runs[number]
            order.append((number, run.a == node))
            far = run.b if run.a == node else run.a
            if far not in seen:
                seen.add(far)
                todo.append(far)
    return order


def _describe(
    net: Netlist, found: Sequence[tuple[int, int, float, float, int | None]], search: _Search
) -> NetMatch:
    """Return the best naming with its lengths, and how far the others are."""
    complete = search.work >= 0
    ranked = sorted(search.found.items(), key=lambda item: item[1][0])
    if not ranked:
        nothing: dict[str, int | None] = dict.fromkeys(net.nodes)
        extra = tuple(range(len(found)))
        return NetMatch(nothing, (), net.edges, extra, math.inf, 0.0, net.nodes, False)
    key, (cost, variant) = ranked[0]
    naming = dict(key)
    open_names = {
        node
        for other, (its, _) in ranked[1:]
        if its - cost < OPEN
        for node in range(len(net.nodes))
        if dict(other).get(node) != naming.get(node)
    }
    edges = []
    for i, j in sorted(variant.pairs, key=lambda pair: variant.net[pair[0]].parts):
        wanted, run = variant.net[i], variant.found[j]
        if naming[wanted.a] != run.a:
            run = _turn(run)
        names = tuple(net.nodes[node] for node in (wanted.a, *wanted.between, wanted.b))
        edges.append(EdgeMatch(names, run.parts, wanted.length, run.length))
    return NetMatch(
        nodes={name: naming.get(number) for number, name in enumerate(net.nodes)},
        edges=tuple(edges),
        missing=tuple(net.edges[number] for number in sorted(variant.missing)),
        extra=tuple(sorted(variant.extra)),
        cost=cost,
        margin=ranked[1][1][0] - cost if len(ranked) > 1 else math.inf,
        open=tuple(net.nodes[node] for node in sorted(open_names)),
        complete=complete,
    )
