"""Ropes as arrays for PyElastica."""

from __future__ import annotations

from typing import Any

import numpy as np

from strand.export.segments import cut_segments, find_normals
from strand.geometry.line import Line


def elastica(chain: Line, spacing: float | None = None) -> dict[str, Any]:
    """Return the geometry of a PyElastica rod: arguments of `CosseratRod.straight_rod`, or of `ring_rod`.

    Add the material: `CosseratRod.straight_rod(**elastica(chain), density=1000.0, youngs_modulus=1e6)`. The
    rod starts in the measured shape, but its rest shape is straight. To make the measured shape its rest
    shape, call `rod.compute_internal_forces_and_torques(0.0)`, then set `rod.rest_kappa[:] = rod.kappa`.

    Parameters
    ----------
    chain : Line
    spacing : float, optional
        Length of elements, metres; three radii by default.

    Returns
    -------
    dict
        `n_elements`; `position`, (3, N + 1), or (3, N) for a ring, metres; `directors`, (3, 3, N), without
        twist: normal, binormal and tangent of each element as rows; `base_length` and `base_radius`, metres;
        `direction` and `normal` of the first element; `start`, or `ring_center_position` for a ring.

    Raises
    ------
    TypeError
        If `chain` is of another type, or `spacing` is not a number.
    ValueError
        If `spacing` is not positive, or so small that there are more than 100,000 elements.
    """
    if not isinstance(chain, Line):
        raise TypeError(f"chain: expected a Chain or Line, got {type(chain).__name__}")
    places = cut_segments(chain, spacing)
    steps, normals = find_normals(places, chain.closed)
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    tangents = steps / lengths
    directors = np.stack([normals, np.cross(tangents, normals), tangents])
    origin = {"ring_center_position": places.mean(axis=0)} if chain.closed else {"start": places[0].copy()}
    return {
        "n_elements": len(steps),
        "position": np.ascontiguousarray(places.T),
        "directors": np.ascontiguousarray(directors.transpose(0, 2, 1)),
        "base_length": float(lengths.sum()),
        "base_radius": chain.radius,
        "direction": tangents[0].copy(),
        "normal": normals[0].copy(),
        **origin,
    }
