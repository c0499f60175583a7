"""Ropes cut into segments of one length, for simulators of rods."""

from __future__ import annotations

import numpy as np

from strand.geometry.line import Line
from strand.support.checks import Array, check_positive

MIN_SPACING = 2.5  # radii: with less, segments touch those after next in bends
_SPACING = 3.0  # radii: default length
_MAX_SEGMENTS = 100_000  # of a rope


def cut_segments(chain: Line, spacing: float | None, least: float = 0.0, fewest: int = 2) -> Array:
    """Return (N + 1, 3) places on the centreline, from end to end, where N segments meet; (N, 3) for a ring.

    Segments are `spacing` metres long or longer, but never fewer than `fewest` (three for a ring). `spacing`
    is at least `least` radii; None means three radii.
    """
    step = _SPACING * chain.radius if spacing is None else check_positive("spacing", spacing)
    if step < least * chain.radius:
        raise ValueError(
            f"spacing: expected at least {least:g} radii, {least * chain.radius:g} m, got {spacing}"
        )
    if chain.length / step > _MAX_SEGMENTS:
        raise ValueError(f"spacing: expected at most {_MAX_SEGMENTS} segments of a rope, got {spacing}")
    count = max(int(chain.length / step), 3 if chain.closed else fewest)
    return chain.at(np.linspace(0.0, chain.length, count + 1)[: count if chain.closed else None])


def find_normals(places: Array, closed: bool) -> tuple[Array, Array]:
    """Return (N, 3) steps of the segments that meet at places, and unit normals that turn without twist."""
    steps = np.diff(places, axis=0, append=places[:1] if closed else np.empty((0, 3)))
    tangents = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    # rings of a tube are twist-free: the first vertex of each gives a direction across
    rings = Line(places, 1.0, closed).tube(3)[0][: 3 * len(places)].reshape(-1, 3, 3)
    across = rings[: len(steps), 0] - places[: len(steps)]
    normals = across - (across * tangents).sum(axis=1, keepdims=True) * tangents
    return steps, normals / np.linalg.norm(normals, axis=1, keepdims=True)
