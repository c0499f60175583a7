"""A harness: ropes that branch, as a graph of junctions, ends and the chains between them."""

from __future__ import annotations

import math
import os
from collections import Counter
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import rustworkx as rx

from strand.export.harness_files import (
    Branch,
    format_edges,
    format_graphml,
    make_harness_mjcf,
    make_harness_urdf,
)
from strand.ropes.chain import Chain
from strand.ropes.net_matching import match_netlist
from strand.ropes.netlist import Netlist, NetMatch
from strand.support.checks import (
    Array,
    check_fraction_or_nan,
    check_instance,
    check_instances,
    check_integer,
    check_positive,
    check_small_array,
    freeze_array,
)
from strand.support.files import check_suffix, write_bytes
from strand.support.lazy import lazy_property

if TYPE_CHECKING:
    from typing_extensions import Self

_MAX_GAP = 1.0  # radii: greatest distance of a chain's end from its node


@dataclass(frozen=True, eq=False)
class HarnessNode:
    """A junction of a harness, or one of its ends. Its arrays are read-only.

    Parameters
    ----------
    id : int
        Its number, which is its place in `Harness.nodes`.
    position : (3,) array_like of float
        World frame, metres: the point that the centrelines share.
    covariance : (3, 3) array_like of float or None
        Of the position, m^2; None if unknown. It is long along the trunk where branches part at a small
        angle.
    degree : int
        Number of edges that end here. An edge that starts and stops here counts twice.
    confidence : float
        Probability that these edges, and no others, meet here; NaN if unknown.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If an array has a wrong shape or is not finite, or a number is out of range.
    """

    id: int
    position: Array
    covariance: Array | None
    degree: int
    confidence: float = float("nan")

    def __post_init__(self) -> None:
        object.__setattr__(self, "id", check_integer("id", self.id))
        object.__setattr__(self, "position", freeze_array(check_small_array("position", self.position, (3,))))
        if self.covariance is not None:
            covariance = check_small_array("covariance", self.covariance, (3, 3))
            object.__setattr__(self, "covariance", freeze_array(covariance))
        object.__setattr__(self, "degree", check_integer("degree", self.degree, 1))
        object.__setattr__(self, "confidence", check_fraction_or_nan("confidence", self.confidence))

    @property
    def kind(self) -> str:
        """`"end"` where one edge ends, else `"junction"`. A ring has one junction, of degree 2."""
        return "end" if self.degree == 1 else "junction"


@dataclass(frozen=True, eq=False)
class HarnessEdge:
    """A stretch of a harness from node to node: one chain.

    Parameters
    ----------
    id : int
        Its number: its place in `Harness.edges`, and in the model's `chains`.
    start, stop : int
        Numbers of the nodes where the chain starts and stops.
    chain : Chain
        The centreline, with its radius and uncertainty. Only one with equal `start` and `stop` may be closed.
    wires : int or None
        Number of wires in it; None if unknown.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If a number is out of range, or a closed chain joins two nodes.
    """

    id: int
    start: int
    stop: int
    chain: Chain
    wires: int | None = None

    def __post_init__(self) -> None:
        for name in ("id", "start", "stop"):
            object.__setattr__(self, name, check_integer(name, getattr(self, name)))
        check_instance("chain", self.chain, Chain)
        if self.chain.closed and self.start != self.stop:
            raise ValueError(f"chain: expected an open one between nodes {self.start} and {self.stop}")
        if self.wires is not None:
            object.__setattr__(self, "wires", check_integer("wires", self.wires, 1))

    @property
    def length(self) -> float:
        """Arc length from node to node, metres."""
        return self.chain.length

    @property
    def radius(self) -> float:
        """The chain's radius, metres."""
        return self.chain.radius

    @property
    def radius_sd(self) -> float:
        """Standard deviation of the radius, metres; 0 if unknown."""
        return self.chain.radius_sd

    def reversed(self) -> Self:
        """Return the same edge from `stop` to `start`."""
        return replace(self, start=self.stop, stop=self.start, chain=self.chain.reversed())


@dataclass(frozen=True, eq=False)
class Harness:
    """Ropes that branch, as a graph. It may have cycles, two edges between two nodes, and several parts.

    Parameters
    ----------
    nodes : sequence of HarnessNode
        Junctions and ends; the number of each is its place.
    edges : sequence of HarnessEdge
        The number of each is its place. Each chain starts and stops within a radius of its nodes.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind; of methods too.
    ValueError
        If a number is not the place, an edge names no node, a chain ends away from its node, or a node's
        degree is not the number of its edges. Of methods, if there is no such node.

    Examples
    --------
    >>> import numpy as np
    >>> import strand
    >>> from strand.ropes.harness import Harness, HarnessEdge, HarnessNode
    >>> places = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.3, 0.1, 0.0], [0.3, -0.1, 0.0]])
    >>> nodes = [HarnessNode(i, places[i], None, degree) for i, degree in enumerate((1, 3, 1, 1))]
    >>> pairs = ((0, 1), (1, 2), (1, 3))
    >>> chains = [strand.Chain(places[list(pair)], 0.003) for pair in pairs]
    >>> edges = [HarnessEdge(i, *pairs[i], chain) for i, chain in enumerate(chains)]
    >>> harness = Harness(nodes, edges)
    >>> [edge.id for edge in harness.path(2, 0)], round(harness.length(2, 0), 3)
    ([1, 0], 0.341)
    """

    nodes: tuple[HarnessNode, ...]
    edges: tuple[HarnessEdge, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", check_instances("nodes", self.nodes, HarnessNode))
        object.__setattr__(self, "edges", check_instances("edges", self.edges, HarnessEdge))
        for name, numbers in (
            ("nodes", [node.id for node in self.nodes]),
            ("edges", [edge.id for edge in self.edges]),
        ):
            for place, number in enumerate(numbers):
                if number != place:
                    raise ValueError(f"{name}[{place}]: expected the number {place}, got {number}")
        degrees = Counter(end for edge in self.edges for end in (edge.start, edge.stop))
        for edge in self.edges:
            for which, number, place in (
                ("start", edge.start, edge.chain.points[0]),
                ("stop", edge.stop, edge.chain.points[0 if edge.chain.closed else -1]),
            ):
                if number >= len(self.nodes):
                    raise ValueError(
                        f"edges[{edge.id}]: expected the number of a node as its {which}, got {number}"
                    )
                gap = float(np.linalg.norm(place - self.nodes[number].position))
                if gap > _MAX_GAP * edge.radius:
                    raise ValueError(
                        f"edges[{edge.id}]: expected a chain whose {which} is within a radius of node "
                        f"{number}, got one {gap * 1e3:.3g} mm away"
                    )
        for node in self.nodes:
            if node.degree != degrees[node.id]:
                raise ValueError(
                    f"nodes[{node.id}]: expected a degree of {degrees[node.id]}, the number of its edges, "
                    f"got {node.degree}"
                )

    def __repr__(self) -> str:
        junctions = sum(node.kind == "junction" for node in self.nodes)
        return (
            f"Harness(edges: {len(self.edges)}, junctions: {junctions}, "
            f"ends: {len(self.nodes) - junctions}, {sum(edge.length for edge in self.edges) * 1e3:.1f} mm)"
        )

    @lazy_property
    def _graph(self) -> rx.PyGraph[int, int]:
        """The graph; its nodes and edges hold their numbers."""
        graph: rx.PyGraph[int, int] = rx.PyGraph()
        graph.add_nodes_from(range(len(self.nodes)))
        graph.add_edges_from([(edge.start, edge.stop, edge.id) for edge in self.edges])
        return graph

    def path(self, a: int, b: int) -> tuple[HarnessEdge, ...]:
        """Return the edges of the shortest way from node to node, each turned along it.

        Parameters
        ----------
        a, b : int
            Numbers of the first and the last node.

        Returns
        -------
        tuple of HarnessEdge
            Empty if both are the same node. A turned edge keeps its number.

        Raises
        ------
        ValueError
            If there is no such node, or no way.
        """
        a, b = self._check_node("a", a), self._check_node("b", b)
        if a == b:
            return ()
        ways = self._find_ways(a)
        if b not in ways:
            raise ValueError(f"b: expected a node that edges join to node {a}, got {b}")
        return tuple(self._choose_edge(*pair) for pair in pairwise(ways[b]))

    def length(self, a: int, b: int) -> float:
        """Return the length of the shortest way from node to node, metres, see `path`."""
        return sum(edge.length for edge in self.path(a, b))

    def branches_at(self, node: int) -> tuple[HarnessEdge, ...]:
        """Return the edges that end at a node, each turned to start there, in the order of their numbers.

        An edge that starts and stops there comes twice, once in each direction.
        """
        node = self._check_node("node", node)
        return tuple(
            turned for edge in self.edges for turned in (edge, edge.reversed()) if turned.start == node
        )

    def tree(self, root: int) -> tuple[HarnessEdge, ...]:
        """Return the edges on the shortest ways from a node to all others, each turned away from the node.

        An edge comes after the one that leads to its start. Edges that would close a cycle, and parts that no
        edge joins to the root, are left out.

        Parameters
        ----------
        root : int
            Number of the node.

        Returns
        -------
        tuple of HarnessEdge
        """
        ways = sorted(self._find_ways(self._check_node("root", root)).values(), key=len)
        return tuple(self._choose_edge(*way[-2:]) for way in ways)

    def match(self, net: Netlist, tolerance: float = 0.03) -> NetMatch:
        """Find which node is which of a netlist, compare lengths, and say what is missing or too many.

        Junctions whose branches are missing cannot be seen; the branches on both sides then count as one.
        Lengths, and numbers of wires where both sides know them, tell isomorphic answers apart; names that
        they leave open are said to be open. Up to three branches may be missing or too many.

        Parameters
        ----------
        net : Netlist
        tolerance : float
            Relative standard deviation of lengths: that of the measurement and of the harness together.

        Returns
        -------
        NetMatch
        """
        check_instance("net", net, Netlist)
        found = [(edge.start, edge.stop, edge.length, edge.radius, edge.wires) for edge in self.edges]
        return match_netlist(net, found, check_positive("tolerance", tolerance, 1.0))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the graph to a file, whole or not at all; an existing file is replaced.

        Parameters
        ----------
        path : str or path-like
            A `.graphml` holds nodes with their places and edges with their lengths, radii and wires. A `.csv`
            has a row for each edge. Lengths are in metres.

        Raises
        ------
        ValueError
            If the name ends with neither.
        OSError
            If the file cannot be written; of the other `save_` methods too.
        """
        if check_suffix(path, ("graphml", "csv")) == "csv":
            rows = [
                (edge.id, edge.start, edge.stop, edge.length, edge.radius, edge.radius_sd, edge.wires)
                for edge in self.edges
            ]
            write_bytes(path, format_edges(rows))
            return
        nodes = [
            {
                "id": node.id,
                "kind": node.kind,
                **dict(zip("xyz", node.position.tolist(), strict=True)),
                "confidence": None if math.isnan(node.confidence) else node.confidence,
            }
            for node in self.nodes
        ]
        names = ("id", "start", "stop", "length", "radius", "radius_sd", "wires")
        edges = [{name: getattr(edge, name) for name in names} for edge in self.edges]
        write_bytes(path, format_graphml(nodes, edges))

    def save_urdf(self, path: str | os.PathLike[str], error: float = 5e-4) -> None:
        """Write the harness as a rigid tree to a URDF file, fixed to the link `world`.

        Each node has a link such as `node_0`, a frame along the world's axes, and each edge one such as
        `edge_0`, welded to the node where it starts. As all is rigid, edges that close a cycle also stay at
        the node where they stop. Shapes are those of `Model.save_urdf`.

        Parameters
        ----------
        path : str or path-like
            Its name ends with `.urdf`.
        error : float
            As in `Model.capsules`, metres.
        """
        check_suffix(path, ("urdf",))
        places = np.reshape([node.position for node in self.nodes], (-1, 3))
        write_bytes(path, make_harness_urdf(places, self._list_trees(), error))

    def save_mjcf(
        self,
        path: str | os.PathLike[str],
        *,
        spacing: float | None = None,
        density: float = 1000.0,
        young: float = 1e6,
    ) -> None:
        """Write the harness as a MuJoCo model of capsules that bends and falls.

        Bodies such as `edge_0_3` hang in each other with ball joints; the first of each edge is welded to its
        junction. Equalities such as `edge_2_weld` weld the last body of edges that close a cycle to the
        junction where they stop. The harness touches other things, not itself.

        Parameters
        ----------
        path : str or path-like
            Its name ends with `.xml`.
        spacing, density, young : optional
            As in `Model.save_mjcf`.
        """
        check_suffix(path, ("xml",))
        places = np.reshape([node.position for node in self.nodes], (-1, 3))
        write_bytes(path, make_harness_mjcf(places, self._list_trees(), spacing, density, young))

    def _list_trees(self) -> list[tuple[int, list[Branch]]]:
        """Return the first node of each part with all its edges: a tree, then those that close cycles."""
        trees: list[tuple[int, list[Branch]]] = []
        for part in rx.connected_components(self._graph):
            root = min(part)
            tree = list(self.tree(root))
            inside = {edge.id for edge in tree}
            tree += [edge for edge in self.edges if edge.start in part and edge.id not in inside]
            trees.append((root, [Branch(edge.id, edge.start, edge.stop, edge.chain) for edge in tree]))
        return trees

    def _find_ways(self, start: int) -> dict[int, list[int]]:
        """Return the nodes along the shortest way from a node to each node that edges join to it."""
        ways = rx.dijkstra_shortest_paths(
            self._graph, start, weight_fn=lambda number: self.edges[number].length
        )
        return {end: list(way) for end, way in ways.items()}

    def _choose_edge(self, a: int, b: int) -> HarnessEdge:
        """Return the shortest of the edges between two nodes, turned to start at the first."""
        numbers = self._graph.get_all_edge_data(a, b)
        edge = min((self.edges[number] for number in numbers), key=lambda edge: (edge.length, edge.id))
        return edge if edge.start == a else edge.reversed()

    def _check_node(self, name: str, number: int) -> int:
        if not self.nodes:
            raise ValueError(f"{name}: expected the number of a node, but the harness has none")
        return check_integer(name, number, 0, len(self.nodes) - 1)


def describe_harness(harness: Harness) -> dict[str, Any]:
    """Return a harness as dicts of its fields. Edges leave out their chains, which the model has."""
    return {
        "nodes": [
            {"kind": node.kind, **{entry.name: getattr(node, entry.name) for entry in fields(node)}}
            for node in harness.nodes
        ],
        "edges": [
            {entry.name: getattr(edge, entry.name) for entry in fields(edge) if entry.name != "chain"}
            for edge in harness.edges
        ],
    }
