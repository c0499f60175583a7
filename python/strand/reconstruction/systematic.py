"""Errors that all pixels of a view share: where the input contradicts an answer.

Noise averages out, and covariances include the rest. Errors of poses, intrinsics or depth's scale do not
average out, and a fit may follow them without a residual. But then poses move farther than the caller says,
ropes leave the extraction range, or a view sees through them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

import strand._core as _core
from strand.config import Config, Poses
from strand.reconstruction.evidence.confidence import to_normal_deviate
from strand.reconstruction.evidence.depth_resolution import find_depth_step, show_in_windows
from strand.reconstruction.stages import Found, Observed
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.pose import measure_motions
from strand.views.view import View

_POSE_FREEDOM = 4  # unknowns of a pose that its error may have moved
_MIN_DEVIATE = 2.5  # standard normal deviate: rarer corrections are more than chance
_DOUBT_PER_DEVIATE = 0.15  # beyond that
_SMALL_MOTION = 0.7  # radii that corrections move ropes: less raises no doubt
_FULL_MOTION = 1.2  # radii that corrections move ropes: more raises all of the doubt
_MARGIN = 0.1  # radii that axes may lie outside the extraction range
_OUTSIDE_DOUBT = 0.2  # doubt per share of the axes that lie outside
MIN_BEHIND = 1.6  # radii behind a rope's surface: farther depths saw through the rope
_HIDDEN_BEHIND = 3.0  # radii: the same for ropes that a matcher's windows hide, which show as their table
_STEPS_BEHIND = 2.0  # steps of depth: as far behind, where steps are wider than ropes
_MAX_THROUGH = 0.06  # share of the places of ropes that a view may see through
_THROUGH_DOUBT = 2.0  # doubt per share beyond that
_MAX_LOST = 0.6  # share of the ropes' pixels that may have no depth
_LOST_DOUBT = 0.7  # doubt per share beyond that
_MIN_PLACES = 10  # places of a rope that a view must show


def doubt_shared_errors(observed: Observed, found: Found, config: Config) -> list[Doubt]:
    """Doubt input that contradicts the answer.

    Parameters
    ----------
    observed : Observed
    found : Found
        The answer, with poses of the observed views.
    config : Config
    """
    doubts = [*_doubt_poses(observed.views, found, config.poses), *_doubt_views(observed, found)]
    if observed.bounds is not None:
        doubts += _doubt_range(found.chains, observed.bounds)
    return doubts


def _doubt_poses(views: Sequence[View], found: Found, prior: Poses) -> Iterator[Doubt]:
    """Doubt poses that registration moved farther than the caller says they are wrong.

    Any of the poses may be wrong: those of views that agree, and the one that is held.
    """
    others = [number for number in range(len(views)) if number != len(views) // 2]
    if not others:
        return
    nodes = np.concatenate([chain.points for chain in found.chains])
    middle, radius = nodes.mean(axis=0), min(chain.radius for chain in found.chains)
    reported = np.array([views[number].pose for number in others])
    motions = np.array([found.poses[number] for number in others]) @ np.linalg.inv(reported)
    changes = measure_motions(motions, middle)
    rotated, shifted = ((of**2).sum(axis=1) for of in (changes[:, :3], changes[:, 3:]))
    squares = rotated / prior.rotation_sd**2 + shifted / prior.translation_sd**2
    rare = max(
        to_normal_deviate(float(squares.sum()), _POSE_FREEDOM * len(others)),
        # the greatest of several
        to_normal_deviate(float(squares.max()), _POSE_FREEDOM) - 0.5 * math.log(len(others)),
    )
    if rare <= _MIN_DEVIATE:
        return
    # |(R - 1) x + t|
    away = nodes @ (motions[:, :3, :3] - np.eye(3)).transpose(0, 2, 1) + motions[:, None, :3, 3]
    far = math.sqrt(float((away**2).sum(axis=2).max()))
    # an error that is small against the ropes leaves the answer right
    share = min(max((far / radius - _SMALL_MOTION) / (_FULL_MOTION - _SMALL_MOTION), 0.0), 1.0)
    reason = (
        f"registration moved views by up to {far * 1e3:.1f} mm, but reported poses should be right to "
        f"{prior.translation_sd * 1e3:.1f} mm and {math.degrees(prior.rotation_sd):.1f} degrees; poses, "
        "intrinsics or depths may be wrong"
    )
    yield Doubt("pose", _DOUBT_PER_DEVIATE * share * (rare - _MIN_DEVIATE), "where the ropes are", reason)


def _doubt_range(chains: Sequence[Chain], bounds: Box) -> Iterator[Doubt]:
    """Doubt ropes whose axes leave the extraction range."""
    outside = [~bounds.holds(chain.points, _MARGIN * chain.radius) for chain in chains]
    share = float(np.concatenate(outside).mean())
    reason = (
        f"{share:.0%} of the ropes' axes lie outside the extraction range, which should hold the ropes; "
        "depths or poses may be wrong, or the range"
    )
    yield Doubt("range", _OUTSIDE_DOUBT * share, "where the ropes are", reason)


def _doubt_views(observed: Observed, found: Found) -> Iterator[Doubt]:
    """Doubt ropes that a view saw through, and ropes most of whose pixels have no depth."""
    worst, where, shown, lost = 0.0, -1, 0, 0
    for number, view, pose in zip(observed.numbers, observed.whole, found.poses, strict=True):
        behind = np.concatenate(
            [measure_depth_behind(view, pose, chain.points, chain.radius) for chain in found.chains]
        )
        # comparisons with NaN are false
        missed = int(np.count_nonzero(behind == np.inf))
        returned = int(np.count_nonzero(behind < np.inf))
        shown, lost = shown + returned, lost + missed
        if returned < _MIN_PLACES:
            continue
        through = int(np.count_nonzero(behind > MIN_BEHIND)) - missed
        if through > _MAX_THROUGH * returned:
            through = (
                int(
                    np.count_nonzero(
                        behind > find_least_behind(view, min(chain.radius for chain in found.chains))
                    )
                )
                - missed
            )
        if through / returned > worst:
            worst, where = through / returned, number
    reason = (
        f"view {where} saw through {worst:.0%} of the ropes; it may show something else, or its pose may be "
        "wrong, such as world-to-camera"
    )
    yield Doubt("view", _THROUGH_DOUBT * max(worst - _MAX_THROUGH, 0.0), "of the ropes found", reason)
    share = lost / max(shown + lost, 1)
    reason = f"{share:.0%} of the pixels that should show the ropes have no depth"
    yield Doubt("points", _LOST_DOUBT * max(share - _MAX_LOST, 0.0), "where the ropes end", reason)


def find_least_behind(view: View, radius: float) -> float:
    """Return how far behind the surface of a rope depths lie at least that saw through it, radii."""
    image = view.image
    if image is None or not image.distance > 0.0:
        return MIN_BEHIND
    clear = min(max(show_in_windows(radius * max(image.camera.focal) / image.distance), 0.0), 1.0)
    in_steps = _STEPS_BEHIND * find_depth_step(image) / radius
    return max(_HIDDEN_BEHIND + clear * (MIN_BEHIND - _HIDDEN_BEHIND), in_steps)


def measure_depth_behind(view: View, pose: Array, nodes: Array, radius: float) -> Array:
    """Return how far behind a rope's surface the depths lie that a view measured there.

    Parameters
    ----------
    view : View
        Uncropped.
    pose : (4, 4) ndarray
        Camera to world.
    nodes : (M, 3) ndarray
        Of the rope, world frame, metres.
    radius : float
        The rope's, metres.

    Returns
    -------
    (M,) ndarray
        For each node, in radii along the camera's axis; negative before the surface, infinite where its pixel
        has no return, NaN where it is in no image.
    """
    image = view.image
    if image is None:
        return np.full(len(nodes), np.nan)
    behind = _core.measure_behind(image.depth, image.camera, pose, nodes, radius)
    return np.asarray(behind / radius + 1.0)
