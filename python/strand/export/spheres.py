"""Ropes as spheres that follow their tubes within a stated error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.export.capsules import make_capsules
from strand.geometry.line import Line
from strand.support.checks import Array, check_positive, freeze_array

# of the error: how far the line of the centres may be from the centreline; spheres need the rest most
_AXIS = 0.25
# errors below this share of the radius would take thousands of spheres
_LEAST = 1e-2


@dataclass(frozen=True, eq=False)
class Spheres:
    """Spheres along ropes, in order.

    Attributes
    ----------
    center : (K, 3) ndarray
        World frame, metres.
    radius : (K,) ndarray
        Metres: the rope's.
    chain : (K,) ndarray of int
        The number of the rope in `Model.chains`.
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
    """Return spheres along chains, see `strand.Model.spheres`.

    Parameters
    ----------
    chains : sequence of Line
    error : float
        How deep the surface may be between two spheres, metres, and how far aside.
    """
    smallest = max((chain.radius for chain in chains), default=0.0) * _LEAST
    if check_positive("error", error) < smallest:
        raise ValueError(f"error: expected at least 0.01 radii, {smallest:g} m, got {error}")
    axes = make_capsules(chains, _AXIS * error)
    centers, radii, numbers = [np.empty((0, 3))], [], []
    for i, (start, stop) in enumerate(zip(axes.start, axes.stop, strict=True)):
        radius = float(axes.radius[i])
        # halfway between centres a step apart the spheres meet at sqrt(radius^2 - step^2 / 4)
        waist = radius - min((1.0 - _AXIS) * error, radius)
        step = 2.0 * math.sqrt(radius**2 - waist**2)
        share = np.linspace(0.0, 1.0, math.ceil(float(axes.lengths[i]) / step) + 1)
        # the next capsule begins where this one ends; a ring where it began
        ends_here = i + 1 == len(axes) or axes.chain[i + 1] != axes.chain[i]
        kept = share if ends_here and not chains[axes.chain[i]].closed else share[:-1]
        centers.append(start + kept[:, None] * (stop - start))
        radii += [radius] * len(kept)
        numbers += [int(axes.chain[i])] * len(kept)
    return Spheres(
        np.concatenate(centers), np.array(radii, dtype=np.float64), np.array(numbers, dtype=np.int64)
    )
