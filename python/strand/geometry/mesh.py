"""Triangle meshes of tubes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from strand.geometry.frames import carry_along_nodes, carry_directions
from strand.support.checks import Array


def make_tube_mesh(
    nodes: Array, tangents: Array, radius: float, closed: bool, sides: int
) -> tuple[Array, NDArray[np.int32]]:
    """Return vertices and triangles of rings around nodes, see `Line.tube`."""
    count = len(nodes)
    if closed and count < 3:
        raise ValueError(f"points: expected at least three nodes of a closed chain, got {count}")
    least = np.eye(3)[np.abs(tangents[0]).argmin()]
    start = np.cross(tangents[0], least)
    across = carry_along_nodes(nodes, tangents, start / np.linalg.norm(start))
    twist = np.zeros(count)
    if closed:
        # once around, the frame is turned against the first one: each ring takes its share of that
        round_ = carry_directions(across[-1], nodes[-1], tangents[-1], nodes[0], tangents[0])
        missing = np.arctan2(np.cross(round_, across[0]) @ tangents[0], round_ @ across[0])
        steps = np.linalg.norm(np.diff(nodes, axis=0, append=nodes[:1]), axis=1)
        twist = missing * np.concatenate([[0.0], np.cumsum(steps[:-1])]) / steps.sum()
    angles = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False) + twist[:, None]
    aside = np.cross(tangents, across)
    rings = nodes[:, None] + radius * (
        np.cos(angles)[..., None] * across[:, None] + np.sin(angles)[..., None] * aside[:, None]
    )
    vertices = rings.reshape(-1, 3)
    # two triangles for each quadrilateral between neighbouring rings
    here = np.arange(count if closed else count - 1)[:, None] * sides + np.arange(sides)
    after = np.roll(here, -1, axis=1)
    ahead, beyond = (here + sides) % (count * sides), (after + sides) % (count * sides)
    walls = np.stack([here, after, beyond, here, beyond, ahead], axis=-1).reshape(-1, 3)
    if closed:
        return vertices, walls.astype(np.int32)
    first, last = np.arange(sides), (count - 1) * sides + np.arange(sides)
    middles = len(vertices) + np.arange(2)
    start = np.stack([np.roll(first, -1), first, np.full(sides, middles[0])], axis=1)
    stop = np.stack([last, np.roll(last, -1), np.full(sides, middles[1])], axis=1)
    vertices = np.concatenate([vertices, nodes[[0, -1]]])
    return vertices, np.concatenate([walls, start, stop]).astype(np.int32)
