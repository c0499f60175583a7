"""Nodes of curves that were fitted to images: chains of them, and distances between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.config import Config
from strand.geometry.curve import Curve
from strand.geometry.polyline import interpolate
from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.views.pose import make_rotation

_NODES_AT_ONCE = 512  # nodes that are compared with all others in one step: memory stays small
_END_SD = 0.5  # radii: standard deviation of a rope's end in a mask


def make_chains(
    images: RopeImages, fit: ImageFit, radius: float, radius_sd: float, config: Config
) -> list[Chain]:
    """Return chains of fitted curves in the curves' order.

    Parameters
    ----------
    images : RopeImages
    fit : ImageFit
        With covariances.
    radius, radius_sd : float
        Metres.
    config : Config
    """
    chains = []
    support = images.count_support(fit)
    for control, covariances, (counts, views) in zip(fit.controls, fit.covariances, support, strict=True):
        curve = Curve.whole(control)
        s = curve.spaced(config.tubes.node_spacing * radius)
        places, tangents, _ = curve.at(s)
        share = s / curve.length
        known = np.linspace(0.0, 1.0, len(covariances))
        covariance = interpolate(share, known, covariances)
        # nodes divide the way from end to end, so they move with the ends
        along = (_END_SD * radius) ** 2 * ((1.0 - share) ** 2 + share**2)
        covariance += (along[:, None] * tangents)[:, :, None] * tangents[:, None, :]
        nearest = np.rint(share * (len(counts) - 1)).astype(np.int64)
        each = np.bincount(nearest, minlength=len(counts))
        chains.append(
            Chain(
                places,
                radius,
                False,
                curve,
                covariance,
                -(-counts[nearest] // each[nearest]),
                views[nearest],
                radius_sd,
            )
        )
    return chains


def correct_poses(poses: Sequence[Array], corrections: Array) -> list[Array]:
    """Return (4, 4) poses after corrections of the cameras' frames: y' = y + w x y + t, Y' = T' y'.

    Parameters
    ----------
    poses : sequence of (4, 4) ndarray
        As reported, camera to world.
    corrections : (V, 6) ndarray
        Rotation vector w, radians, and translation t, metres.
    """
    found = []
    for pose, correction in zip(poses, corrections, strict=True):
        if not correction.any():
            found.append(pose)
            continue
        *turn, x, y, z = correction
        motion = np.eye(4)
        angle = float(np.linalg.norm(turn))
        if angle > 0.0:
            motion[:3, :3] = make_rotation(np.array(turn) / angle, angle)
        motion[:3, 3] = x, y, z
        found.append(pose @ np.linalg.inv(motion))
    return found


def iterate_squared_distances(nodes: Array, others: Array) -> Iterator[tuple[slice, Array]]:
    """Yield squared distances, (K, N) square metres, of each part of (M, 3) nodes to (N, 3) others."""
    for first in range(0, len(nodes), _NODES_AT_ONCE):
        some = slice(first, first + _NODES_AT_ONCE)
        squares = np.zeros((len(nodes[some]), len(others)))
        for k in range(3):
            squares += (nodes[some, k, None] - others[:, k]) ** 2
        yield some, squares
