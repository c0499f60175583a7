"""Random netlists, and the graphs that a camera finds of them: measured, incomplete, or with too much."""

from __future__ import annotations

from collections import Counter

import numpy as np

from strand.ropes.netlist import Netlist

Found = tuple[int, int, float, float, "int | None"]
"""An edge that was found: start, stop, length, radius, wires."""

LENGTHS = (0.05, 0.6)  # metres: range of branches
ERROR = 0.01  # relative standard deviation of measured lengths
RADIUS = 0.003  # metres


def draw_netlist(rng: np.random.Generator, junctions: int) -> Netlist:
    """Return a tree with junctions of three or four branches."""
    edges: list[tuple[str, str, float]] = []
    leaves, count = ["N0"], 1
    for number in range(junctions):
        chosen = leaves.pop(int(rng.integers(len(leaves))))
        for _ in range(int(rng.choice([2, 3], p=[0.75, 0.25])) + (number == 0)):
            edges.append((chosen, f"N{count}", float(rng.uniform(*LENGTHS))))
            leaves.append(f"N{count}")
            count += 1
    return Netlist(edges)


def measure(
    rng: np.random.Generator, net: Netlist, change: str
) -> tuple[list[Found], dict[str, int | None], object]:
    """Return the edges found of a netlist, the node of each name, and what was changed.

    `change` is "none", "missing", "too many" or "longer": a leaf is left out, one is added on an edge, or an
    edge is 10 % longer. Nodes with two edges cannot be seen: their edges are found as one.
    """
    edges = [[edge.start, edge.stop, edge.length] for edge in net.edges]
    degrees = Counter(name for edge in net.edges for name in edge[:2])
    changed: object = None
    if change == "missing":
        outer = [i for i, edge in enumerate(edges) if degrees[edge[0]] == 1 or degrees[edge[1]] == 1]
        changed = net.edges[outer[int(rng.integers(len(outer)))]]
        edges = [edge for edge, one in zip(edges, net.edges, strict=True) if one is not changed]
    elif change == "too many":
        start, stop, length = edges.pop(int(rng.integers(len(edges))))
        share = float(rng.uniform(0.2, 0.8))
        edges += [[start, "?", share * length], ["?", stop, (1 - share) * length]]
        edges.append(["?", "??", float(rng.uniform(*LENGTHS))])
        changed = "??"
    elif change == "longer":
        number = int(rng.integers(len(edges)))
        edges[number][2] *= 1.1
        changed = net.edges[number]
    for edge in edges:
        edge[2] *= 1.0 + ERROR * float(rng.normal())
    for name in net.nodes:
        meet = [edge for edge in edges if name in edge[:2]]
        if len(meet) == 2:
            far = [edge[1] if edge[0] == name else edge[0] for edge in meet]
            edges = [edge for edge in edges if name not in edge[:2]]
            edges.append([*far, meet[0][2] + meet[1][2]])
    names = sorted({name for edge in edges for name in edge[:2]})
    place = dict(zip(rng.permutation(names).tolist(), range(len(names)), strict=True))
    ordered = [edges[number] for number in rng.permutation(len(edges))]
    found = [(place[start], place[stop], length, RADIUS, None) for start, stop, length in ordered]
    if change == "too many":
        changed = next(i for i, edge in enumerate(found) if place["??"] in edge[:2])
    return found, {name: place.get(name) for name in net.nodes}, changed
