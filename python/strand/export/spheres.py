"""Ropes as spheres within a given error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.export.capsules import make_capsules
from strand.geometry.line import Line
from strand.support.checks import Array, check_positive, freeze_array

_AXIS_SHARE = 0.25  # of the error: for the distance of the centres' path from the centreline
_MIN_ERROR = 1e-2  # radii; below, thousands of spheres would be needed


@dataclass(frozen=True, eq=False)
class Spheres:
    """Spheres along ropes, in order.

    Attributes
    ----------
    center : (K, 3) ndarray
        World frame, metres.
    radius : (K,) ndarray
        Radius of the rope, metres.
    chain : (K,) ndarray of int
        Number of the rope in `Model.chains`.
    """

    center: Array
    radius: Array
    chain: NDArray[np.int64]

    def __post_init__(self) -> None:
        for name in ("center", "radius", "chain"):
            object.__setattr__(self, name, freeze_array(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.radius)

    def __repr__(self) -> str:
        return f"Spheres({len(self)} of {len(np.unique(self.chain))} ropes)"


def make_spheres(chains: Sequence[Line], error: float) -> Spheres:
    """Return spheres along chains, see `strand.Model.spheres`."""
    smallest = max((chain.radius for chain in chains), default=0.0) * _MIN_ERROR
    if check_positive("error", error) < smallest:
        raise ValueError(f"error: expected at least 0.01 radii, {smallest:g} m, got {error}")
    axes = make_capsules(chains, _AXIS_SHARE * error)
    centers, radii, numbers = [np.empty((0, 3))], [], []
    for i, (start, stop) in enumerate(zip(axes.start, axes.stop, strict=True)):
        radius = float(axes.radius[i])
        # halfway between two centres the spheres meet sqrt(radius^2 - step^2 / 4) from the axis
        waist = radius - min((1.0 - _AXIS_SHARE) * error, radius)
        step = 2.0 * math.sqrt(radius**2 - waist**2)
        share = np.linspace(0.0, 1.0, math.ceil(float(axes.lengths[i]) / step) + 1)
        # the next capsule starts where this one ends; that of a ring ends where it started
        ends_here = i + 1 == len(axes) or axes.chain[i + 1] != axes.chain[i]
        kept = share if ends_here and not chains[axes.chain[i]].closed else share[:-1]
        centers.append(start + kept[:, None] * (stop - start))
        radii += [radius] * len(kept)
        numbers += [int(axes.chain[i])] * len(kept)
    return Spheres(
        np.concatenate(centers), np.array(radii, dtype=np.float64), np.array(numbers, dtype=np.int64)
    )
