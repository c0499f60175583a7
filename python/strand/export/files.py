"""Files of ropes: tables of nodes, polylines and meshes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.geometry.line import Line
from strand.support.checks import Array

COLUMNS = ("chain", "node", "s", "x", "y", "z", "radius", "closed", "points_seen")

_PLACE = [("x", "<f8"), ("y", "<f8"), ("z", "<f8")]


def format_csv(chains: Sequence[Line]) -> bytes:
    """Return a table with a row for each node, numbers to the last bit; unknown values are empty."""
    rows = [",".join(COLUMNS)]
    for k, chain in enumerate(chains):
        seen = [""] * len(chain.points) if chain.points_seen is None else chain.points_seen.tolist()
        for i, (s, place) in enumerate(zip(chain.arc_length.tolist(), chain.points.tolist(), strict=True)):
            values = (k, i, s, *place, chain.radius, int(chain.closed), seen[i])
            rows.append(",".join(str(value) for value in values))
    return ("\n".join(rows) + "\n").encode()


def format_polylines(chains: Sequence[Line]) -> bytes:
    """Return a binary PLY file with the nodes as vertices, and an edge from each node to the next."""
    counts = [len(chain.points) for chain in chains]
    number = np.repeat(np.arange(len(chains)), counts)
    vertices = np.empty(sum(counts), dtype=[*_PLACE, ("radius", "<f8"), ("chain", "<i4")])
    _set_places(vertices, [chain.points for chain in chains])
    vertices["radius"] = np.array([chain.radius for chain in chains])[number] if chains else 0.0
    vertices["chain"] = number
    edges: list[NDArray[Any]] = [np.empty((0, 2), dtype=np.intp)]
    for start, count, chain in zip(_number_starts(counts), counts, chains, strict=True):
        nodes = np.arange(start, start + count)
        edges.append(np.stack([nodes, np.roll(nodes, -1)], axis=1)[: count if chain.closed else -1])
    pairs = np.concatenate(edges)
    links = np.empty(len(pairs), dtype=[("vertex1", "<i4"), ("vertex2", "<i4")])
    links["vertex1"], links["vertex2"] = pairs.T
    names = ("x", "y", "z", "radius")
    return _format_ply(
        ("vertex", vertices, [*(f"double {name}" for name in names), "int chain"]),
        ("edge", links, ["int vertex1", "int vertex2"]),
    )


def format_mesh(tubes: Sequence[tuple[Array, NDArray[np.int32]]]) -> bytes:
    """Return a binary PLY file with the vertices and triangles of meshes, in their order."""
    counts = [len(vertices) for vertices, _ in tubes]
    vertices = np.empty(sum(counts), dtype=_PLACE)
    _set_places(vertices, [places for places, _ in tubes])
    triangles = np.concatenate(
        [
            np.empty((0, 3), dtype=np.intp),
            *(start + corners for start, (_, corners) in zip(_number_starts(counts), tubes, strict=True)),
        ]
    )
    faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, triangles
    return _format_ply(
        ("vertex", vertices, [f"double {axis}" for axis in "xyz"]),
        ("face", faces, ["list uchar int vertex_indices"]),
    )


def _number_starts(counts: list[int]) -> list[int]:
    """Return the number of the first vertex of each part."""
    return [0, *accumulate(counts)][:-1]


def _set_places(table: NDArray[Any], parts: Sequence[Array]) -> None:
    """Write the parts' places (N, 3) into the columns of a table."""
    for i, axis in enumerate("xyz"):
        table[axis] = np.concatenate([np.empty(0), *(part[:, i] for part in parts)])


def _format_ply(*elements: tuple[str, NDArray[Any], list[str]]) -> bytes:
    """Return a PLY file of elements, each with its name, rows and properties."""
    header = ["ply", "format binary_little_endian 1.0", "comment strand, metres"]
    for name, rows, properties in elements:
        header += [f"element {name} {len(rows)}", *(f"property {one}" for one in properties)]
    return "\n".join([*header, "end_header\n"]).encode() + b"".join(rows.tobytes() for _, rows, _ in elements)
