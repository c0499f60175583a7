"""Nodes of the chains: places on the fitted curves, their covariance, and what saw them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import TubeFit
from strand.config import Config
from strand.geometry.curve import Curve, evaluate_basis
from strand.reconstruction.tubes.tube_ends import end_deviations
from strand.ropes.chain import Chain
from strand.support.checks import Array

# nodes of a ring, the first counted twice
_LEAST_OF_RING = 4


def as_chains(
    fit: TubeFit, parts: Sequence[Curve | None], closed: Sequence[bool], radii_sd: Array, config: Config
) -> list[Chain]:
    """Make chains of fitted curves.

    Parameters
    ----------
    fit : TubeFit
    parts : sequence of (Curve or None)
        The stretch of each curve that is rope; None leaves it out.
    closed : sequence of bool
        Whether each goes on from its end to its start.
    radii_sd : (C,) ndarray
        Standard deviation of each curve's radius, metres.
    config : Config

    Returns
    -------
    list of Chain
        In the curves' order, without rings of hardly any length.
    """
    chains = []
    for number, (part, ring) in enumerate(zip(parts, closed, strict=True)):
        if part is None:
            continue
        s = part.spaced(config.tubes.node_spacing * fit.radius(number))
        if ring and len(s) < _LEAST_OF_RING:
            continue
        mine = np.flatnonzero(fit.inlier & (fit.curve == number))
        place = part.arc_length_at(fit.parameter[mine])
        counts, views = _seen(place, fit.view[mine], s)
        places, tangents, _ = part.at(s)
        covariance = node_covariance(fit.covariances[number], part.parameter_at(s))
        if not ring:
            # nodes divide the way from end to end: they go along with the ends
            share = s / part.length
            start, stop = end_deviations(fit, number, part, mine, place)
            along = ((1.0 - share) * start) ** 2 + (share * stop) ** 2
            covariance = covariance + along[:, None, None] * tangents[:, :, None] * tangents[:, None, :]
        # a ring's last node is its first again
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


def _seen(places: Array, view: np.ndarray, nodes: Array) -> tuple[np.ndarray, np.ndarray]:
    """Count the points, and the views they come from, that are nearest to each node."""
    spacing = nodes[1] - nodes[0]
    nearest = np.clip(np.rint(places / spacing).astype(np.int64), 0, len(nodes) - 1)
    counts = np.bincount(nearest, minlength=len(nodes))
    cameras = int(view.max(initial=0)) + 1
    pairs = np.bincount(nearest * cameras + view, minlength=len(nodes) * cameras)
    return counts, np.count_nonzero(pairs.reshape(len(nodes), cameras), axis=1)


def node_covariance(covariance: Array, parameter: Array) -> Array:
    """Covariance of places of a spline.

    Parameters
    ----------
    covariance : (n, 4, 3, 3) ndarray
        Of each control point with itself and the next three, m^2.
    parameter : (M,) ndarray

    Returns
    -------
    (M, 3, 3) ndarray
        sum_ij B_i B_j C_ij, m^2.
    """
    first, weights = evaluate_basis(parameter, len(covariance))
    total = np.zeros((len(parameter), 3, 3))
    for i in range(4):
        for j in range(i, 4):
            block = (weights[:, i] * weights[:, j])[:, None, None] * covariance[first + i, j - i]
            total += block if i == j else block + block.transpose(0, 2, 1)
    return total
