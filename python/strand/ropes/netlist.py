"""A netlist: the harness as it should be, and what a match with a found one says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import rustworkx as rx

from strand.support.checks import check_integer, check_positive, check_sequence, check_text

_MAX_LENGTH = 1e4  # metres: longest edge


class NetEdge(NamedTuple):
    """A branch of a netlist.

    Attributes
    ----------
    start, stop : str
        Names of the nodes that it joins.
    length : float
        Metres.
    wires : int or None
        Number of wires in it; None if unknown.
    """

    start: str
    stop: str
    length: float
    wires: int | None


@dataclass(frozen=True)
class Netlist:
    """A harness as it should be: named nodes, and the branches between them.

    Parameters
    ----------
    edges : sequence of (str, str, float)
        The names of two nodes and the length of the branch between them, metres.
    wires : sequence of (int or None), optional
        Number of wires in each branch; None for one that is unknown.

    Attributes
    ----------
    nodes : tuple of str
        All names, in the order in which they come first.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If there are no branches, a length is not positive, a branch joins a node with itself or comes twice,
        the branches do not hang together, or the numbers of branches and of `wires` differ.

    Examples
    --------
    >>> import strand
    >>> net = strand.Netlist(edges=[("plug", "J1", 0.32), ("J1", "ecu", 0.11), ("J1", "lamp", 0.2)])
    >>> net.nodes
    ('plug', 'J1', 'ecu', 'lamp')
    """

    edges: tuple[NetEdge, ...]
    wires: tuple[int | None, ...] | None = None
    nodes: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        given = check_sequence("edges", self.edges, "(str, str, float)")
        if not given:
            raise ValueError("edges: expected at least one branch, got none")
        wires: tuple[int | None, ...] = (None,) * len(given)
        if self.wires is not None:
            wires = tuple(
                None if count is None else check_integer(f"wires[{i}]", count, 1)
                for i, count in enumerate(check_sequence("wires", self.wires, "numbers of wires"))
            )
            if len(wires) != len(given):
                raise ValueError(f"wires: expected one for each edge ({len(given)}), got {len(wires)}")
            object.__setattr__(self, "wires", wires)
        edges = tuple(
            _check_edge(f"edges[{i}]", *pair) for i, pair in enumerate(zip(given, wires, strict=True))
        )
        seen = set()
        for i, edge in enumerate(edges):
            key = (*sorted(edge[:2]), edge.length)
            if key in seen:
                raise ValueError(
                    f"edges[{i}]: expected each branch once, got {edge.start} to {edge.stop} twice "
                    "with one length"
                )
            seen.add(key)
        nodes = tuple(dict.fromkeys(name for edge in edges for name in edge[:2]))
        _check_connected(edges, nodes)
        object.__setattr__(self, "edges", edges)
        object.__setattr__(self, "nodes", nodes)


def _check_edge(name: str, value: Sequence[object], wires: int | None) -> NetEdge:
    parts = check_sequence(name, value, "two names and a length")
    if isinstance(value, NetEdge):
        parts = parts[:3]
    if len(parts) != 3:
        raise ValueError(f"{name}: expected two names and a length, got {len(parts)} values")
    start, stop = check_text(name, parts[0]), check_text(name, parts[1])
    if not start or not stop:
        raise ValueError(f"{name}: expected names of nodes, got an empty one")
    if start == stop:
        raise ValueError(f"{name}: expected two different nodes, got {start} twice")
    return NetEdge(start, stop, check_positive(name, parts[2], _MAX_LENGTH), wires)


def _check_connected(edges: Sequence[NetEdge], nodes: Sequence[str]) -> None:
    graph: rx.PyGraph[str, None] = rx.PyGraph()
    graph.add_nodes_from(nodes)
    graph.add_edges_from_no_data([(nodes.index(edge.start), nodes.index(edge.stop)) for edge in edges])
    whole = rx.node_connected_component(graph, 0)
    apart = [name for number, name in enumerate(nodes) if number not in whole]
    if apart:
        raise ValueError(f"edges: expected one connected netlist, got {apart[0]} without a way to {nodes[0]}")


@dataclass(frozen=True)
class EdgeMatch:
    """A branch of a netlist beside what was found.

    Attributes
    ----------
    names : tuple of str
        The nodes that it joins. In between are nodes that cannot be seen, since their branches are missing.
    edges : tuple of int
        Numbers of the found edges along it, from the first name on. They are several where a branch that
        the netlist lacks leaves in between.
    expected, found : float
        Lengths, metres.
    """

    names: tuple[str, ...]
    edges: tuple[int, ...]
    expected: float
    found: float

    @property
    def difference(self) -> float:
        """Length found less that expected, metres."""
        return self.found - self.expected

    def __str__(self) -> str:
        return (
            f"{' to '.join(self.names)}: {self.found * 1e3:.0f} mm, expected {self.expected * 1e3:.0f} mm "
            f"({100 * self.difference / self.expected:+.1f} %)"
        )


@dataclass(frozen=True)
class NetMatch:
    """Which node of a found harness is which of a netlist.

    Attributes
    ----------
    nodes : dict of str to (int or None)
        The found node of each name; None where there is none, as at a junction whose branch is missing.
    edges : tuple of EdgeMatch
        Branches that were found, with their lengths.
    missing : tuple of NetEdge
        Branches that were not found.
    extra : tuple of int
        Numbers of found edges that the netlist lacks.
    cost : float
        Negative logarithm of the match's likelihood, up to a constant.
    margin : float
        The extra cost of the next best match with other names; infinite if there is none.
    open : tuple of str
        Names that could as well stand elsewhere: matches with a margin below 3 give them other nodes.
    complete : bool
        Whether all matches were compared. If not, a better one may exist; `nodes` may have no names at all.
    """

    nodes: dict[str, int | None]
    edges: tuple[EdgeMatch, ...]
    missing: tuple[NetEdge, ...]
    extra: tuple[int, ...]
    cost: float
    margin: float
    open: tuple[str, ...]
    complete: bool

    def __str__(self) -> str:
        lines = [str(edge) for edge in self.edges]
        lines += [f"missing: {edge.start} to {edge.stop}" for edge in self.missing]
        lines += [f"too many: edge {number}" for number in self.extra]
        lines += [f"open: {', '.join(self.open)}"] if self.open else []
        lines += [] if self.complete else ["not all matches were compared"]
        return "\n".join(lines)
