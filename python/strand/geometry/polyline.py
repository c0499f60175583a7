"""Ordered nodes: arc length, values between nodes, marked stretches, the order of joined segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rustworkx as rx
from numpy.typing import ArrayLike, NDArray

from strand._core import bridge, end_direction, find_runs, interpolate, path_length
from strand.support.checks import Array, to_array

__all__ = [
    "bridge",
    "check_node_values",
    "end_direction",
    "find_runs",
    "interpolate",
    "order_segments",
    "path_length",
]


def check_node_values(name: str, value: ArrayLike, shape: tuple[int, ...], counts: bool) -> NDArray[Any]:
    """Return an argument with one value for each node: finite floats, or counts."""
    array = to_array(name, value)
    if array.dtype.kind not in ("iu" if counts else "f"):
        raise TypeError(f"{name}: expected numbers of its kind, got dtype {array.dtype}")
    if array.shape != shape:
        raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{name}: expected finite numbers, got NaN or infinity")
    if counts and (array < 0).any():
        raise ValueError(f"{name}: expected counts, got negative numbers")
    return array


def order_segments(count: int, joins: Sequence[tuple[int, int]]) -> list[tuple[list[int], bool]]:
    """Order the segments of each rope. `joins` are pairs of ends; no end is in two pairs.

    End 2k is the start of segment k, end 2k + 1 its stop. For each rope, the function returns the ends at
    which a walk along it enters the segments, and whether the last segment is joined to the first.
    """
    graph = rx.PyGraph()
    graph.add_nodes_from(range(2 * count))
    graph.add_edges_from_no_data([(2 * k, 2 * k + 1) for k in range(count)])
    graph.add_edges_from_no_data(list(joins))
    mate = {a: b for pair in joins for a, b in (pair, pair[::-1])}
    ropes = []
    for component in sorted(rx.connected_components(graph), key=min):
        open_ends = sorted(end for end in component if end not in mate)
        end = open_ends[0] if open_ends else min(component)
        entered = [end]
        while len(entered) < len(component) // 2:
            entered.append(mate[entered[-1] ^ 1])
        ropes.append((entered, not open_ends))
    return ropes


def bound_polylines(polylines: Sequence[Array]) -> tuple[Array, Array]:
    """Return (K, 3) low and high corners of boxes around polylines, (M, 3) each."""
    return (
        np.array([nodes.min(axis=0) for nodes in polylines]).reshape(-1, 3),
        np.array([nodes.max(axis=0) for nodes in polylines]).reshape(-1, 3),
    )


def measure_gaps(boxes: tuple[Array, Array], place: Array) -> Array:
    """(K,) Return the distances of a place from boxes, given by (K, 3) corners; 0 inside."""
    low, high = boxes
    return np.asarray(np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0), axis=1))
