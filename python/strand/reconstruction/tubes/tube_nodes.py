"""Make chains of fitted curves: nodes, their covariance, and the points that support them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.config import Config
from strand.geometry.curve import Curve
from strand.reconstruction.tubes.tube_ends import estimate_end_deviations
from strand.ropes.chain import Chain
from strand.support.checks import Array

_MIN_RING_NODES = 4  # the first node counts twice


def make_chains(
    fit: TubeFit, parts: Sequence[Curve | None], closed: Sequence[bool], radii_sd: Array, config: Config
) -> list[Chain]:
    """Make chains of the curves' stretches that are rope; skip None, and rings of hardly any length."""
    chains = []
    for number, (part, ring) in enumerate(zip(parts, closed, strict=True)):
        if part is None:
            continue
        s = part.spaced(config.tubes.node_spacing * fit.radius(number))
        if ring and len(s) < _MIN_RING_NODES:
            continue
        mine = np.flatnonzero(fit.inlier & (fit.curve == number))
        place = part.arc_length_at(fit.parameter[mine])
        counts, views = _core.count_seen(place, fit.view[mine], s)
        places, tangents, _ = part.at(s)
        covariance = _core.propagate_covariances(fit.covariances[number], part.parameter_at(s))
        if not ring:
            # nodes are spaced evenly between the ends, so they move with them
            share = s / part.length
            start, stop = estimate_end_deviations(fit, number, part, mine, place)
            along = ((1.0 - share) * start) ** 2 + (share * stop) ** 2
            covariance = covariance + along[:, None, None] * tangents[:, :, None] * tangents[:, None, :]
        # a ring's last node repeats its first
        kept = slice(0, len(s) - 1 if ring else len(s))
        chains.append(
            Chain(
                places[kept],
                fit.radius(number),
                ring,
                None if ring else part,
                covariance[kept],
                counts[kept],
                views[kept],
                float(radii_sd[number]),
            )
        )
    return chains
