"""The parts of chains that several pictures draw: paths, ends, colours and standard deviations."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from strand.ropes.chain import Chain
from strand.ropes.model import Model
from strand.ropes.notebook import PALETTE
from strand.support.checks import Array


def close_path(chain: Chain) -> Array:
    """Return (M, 3) the nodes of a chain; a closed chain repeats the first node at the end."""
    return np.vstack([chain.points, chain.points[:1]]) if chain.closed else chain.points


def find_ends(paths: Iterable[Array]) -> Array:
    """Return (2 N, 3) the first and last points of N paths."""
    return np.array([end for path in paths for end in (path[0], path[-1])]).reshape(-1, 3)


def find_rope_ends(model: Model) -> Array:
    """Return (2 N, 3) the ends of the N open chains, or those of a harness."""
    if model.harness is not None:
        ends = [node.position for node in model.harness.nodes if node.kind == "end"]
        return np.array(ends).reshape(-1, 3)
    return find_ends(chain.points for chain in model.chains if not chain.closed)


def find_junctions(model: Model) -> Array:
    """Return (N, 3) the junctions of a model's harness."""
    nodes = () if model.harness is None else model.harness.nodes
    return np.array([node.position for node in nodes if node.kind == "junction"]).reshape(-1, 3)


def pick_color(i: int) -> str:
    """Return the palette's colour for chain number `i`."""
    return PALETTE[i % len(PALETTE)]


def color_paths(paths: Iterable[Array]) -> list[tuple[Array, str]]:
    """Return each path with its colour."""
    return [(path, pick_color(i)) for i, path in enumerate(paths)]


def compute_deviations(chain: Chain) -> Array | None:
    """Return (M,) the standard deviation of each node in its worst direction, metres; None if not known."""
    if chain.covariance is None:
        return None
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(chain.covariance)[:, -1], 0.0)))
