"""The graph of a harness: which nodes its strands start and stop at, and how sure each node is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.reconstruction.harness.strands import Strand
from strand.ropes.chain import Chain
from strand.ropes.harness import Harness, HarnessEdge, HarnessNode
from strand.support.checks import Array


@dataclass(frozen=True, eq=False)
class Graph:
    """Nodes, and the two that each strand joins: junctions first, then free ends.

    Attributes
    ----------
    places : (N, 3) ndarray
        Metres.
    covariances : (N, 3, 3) ndarray
        Of these, m^2.
    pairs : list of (int, int)
        The nodes where each strand starts and stops.
    """

    places: Array
    covariances: Array
    pairs: list[tuple[int, int]]

    @property
    def degrees(self) -> list[int]:
        """Number of ends of strands at each node."""
        counts = Counter(node for pair in self.pairs for node in pair)
        return [counts[node] for node in range(len(self.places))]

    def list_free_ends(self) -> list[tuple[int, int]]:
        """Return the strand's number, and 0 for its first or 1 for its last node, of each free end."""
        degrees = self.degrees
        return [
            (number, late)
            for number, pair in enumerate(self.pairs)
            for late in (0, 1)
            if degrees[pair[late]] == 1
        ]


def make_graph(
    chains: Sequence[Chain], strands: Sequence[Strand], places: Array, covariances: Array
) -> Graph:
    """Return the graph of strands.

    Parameters
    ----------
    chains : sequence of Chain
        The fitted strands.
    strands : sequence of Strand
        The same before the fit.
    places : (J, 3) ndarray
        The junctions, metres.
    covariances : (J, 3, 3) ndarray
        Of these, m^2.
    """
    used = sorted({end for strand in strands for end in strand.ends if end is not None})
    numbers = {junction: number for number, junction in enumerate(used)}
    nodes, spreads = [places[junction] for junction in used], [covariances[junction] for junction in used]
    pairs = []
    for chain, strand in zip(chains, strands, strict=True):
        pair = []
        for late in (0, 1):
            end = strand.ends[late]
            if end is not None:
                pair.append(numbers[end])
            elif late and chain.closed:
                pair.append(pair[0])
            else:
                pair.append(len(nodes))
                nodes.append(chain.points[-late])
                spreads.append(np.zeros((3, 3)) if chain.covariance is None else chain.covariance[-late])
        pairs.append((pair[0], pair[1]))
    return Graph(np.array(nodes), np.array(spreads), pairs)


def make_harness(
    graph: Graph, chains: Sequence[Chain], confidences: Sequence[float], wires: Sequence[int | None]
) -> Harness:
    """Return the harness of chains, with the confidence of each node and the wires of each chain."""
    nodes = [
        HarnessNode(number, place, covariance, degree, confidence)
        for number, (place, covariance, degree, confidence) in enumerate(
            zip(graph.places, graph.covariances, graph.degrees, confidences, strict=True)
        )
    ]
    edges = [
        HarnessEdge(number, *pair, chain, count)
        for number, (pair, chain, count) in enumerate(zip(graph.pairs, chains, wires, strict=True))
    ]
    return Harness(tuple(nodes), tuple(edges))
