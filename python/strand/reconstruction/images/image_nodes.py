"""Chains made of curves that were fitted to images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import ImageFit, RopeImages
from strand.config import Config
from strand.geometry.curve import Curve
from strand.geometry.polyline import between
from strand.ropes.chain import Chain
from strand.support.checks import Array
from strand.views.pose import rotation_about

# the standard deviation of where a mask shows an end, in radii
_END_SD = 0.5


def as_chains(
    images: RopeImages, fit: ImageFit, radius: float, radius_sd: float, config: Config
) -> list[Chain]:
    """Make chains of fitted curves.

    Parameters
    ----------
    images : RopeImages
    fit : ImageFit
        With covariances.
    radius, radius_sd : float
        Metres.
    config : Config

    Returns
    -------
    list of Chain
        In the curves' order.
    """
    chains = []
    support = images.support(fit)
    for control, covariances, (counts, views) in zip(fit.controls, fit.covariances, support, strict=True):
        curve = Curve.whole(control)
        s = curve.nodes(config.tubes.node_spacing * radius)
        places, tangents, _ = curve.at(s)
        share = s / curve.length
        known = np.linspace(0.0, 1.0, len(covariances))
        covariance = between(share, known, covariances)
        # nodes divide the way from end to end: they go along with the ends
        along = (_END_SD * radius) ** 2 * ((1.0 - share) ** 2 + share**2)
        covariance = covariance + along[:, None, None] * tangents[:, :, None] * tangents[:, None, :]
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


def corrected_poses(poses: Sequence[Array], corrections: Array) -> list[Array]:
    """Return poses after corrections of the cameras' frames: y' = y + w x y + t, Y' = T' y'.

    Parameters
    ----------
    poses : sequence of (4, 4) ndarray
        As reported, camera to world.
    corrections : (V, 6) ndarray
        Rotation vector w, radians, and translation t, metres.

    Returns
    -------
    list of (4, 4) ndarray
    """
    found = []
    for pose, (*turn, x, y, z) in zip(poses, corrections, strict=True):
        motion = np.eye(4)
        angle = float(np.linalg.norm(turn))
        if angle > 0.0:
            motion[:3, :3] = rotation_about(np.array(turn) / angle, angle)
        motion[:3, 3] = x, y, z
        found.append(pose @ np.linalg.inv(motion))
    return found
