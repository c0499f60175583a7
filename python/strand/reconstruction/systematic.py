"""Errors that all pixels of a view share: where what was given contradicts an answer of either method.

Noise averages out, and covariances say what is left of it. An error of a pose, of intrinsics or of depth's
scale does not, and a fit may follow it without a residual. But poses then move farther than they are said to
be wrong, ropes leave the extraction range, or a view sees through them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

import strand._core as _core
from strand.config import Config, Poses
from strand.reconstruction.stages import Found, Observed
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.pose import rotation_vector
from strand.views.view import View

# unknowns of a pose that its error may have moved; the standard normal deviate beyond which corrections are
# more than chance, and the doubt for each deviate more
_POSE, _CHANCE, _CORRECTED = 4, 2.5, 0.15
# corrections that move ropes by less than the first, in radii, raise none of it, by the second all
_SMALL = (0.7, 1.2)
# doubt for the share of axes that lie outside the extraction range by more than so many radii
_OUTSIDE, _OUT = 0.1, 0.2
# a depth so many radii behind the surface saw through the rope; share of the places that a view may see
# through, and doubt for each share more
_BEHIND, _SEEN_THROUGH, _THROUGH = 1.6, 0.06, 2.0
# share of the ropes' pixels that may be lost, and doubt for the share that is more
_USUALLY_LOST, _LOST = 0.6, 0.7
# fewest places of a rope that a view must show
_FEWEST = 10


def doubts(observed: Observed, found: Found, config: Config) -> list[Doubt]:
    """Say where what was given contradicts the answer.

    Parameters
    ----------
    observed : Observed
    found : Found
        The answer, with poses of the observed views.
    config : Config

    Returns
    -------
    list of Doubt
    """
    said = [*_of_poses(observed.views, found, config.poses), *_of_views(observed.whole, found)]
    if observed.bounds is not None:
        said += _of_range(found.chains, observed.bounds)
    return said


def deviate(square: float, freedom: int) -> float:
    """Return the standard normal deviate as rare as a chi-square (Wilson and Hilferty 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return float(((square / freedom) ** (1.0 / 3.0) - 1.0 + spread) / math.sqrt(spread))


def _of_poses(views: Sequence[View], found: Found, prior: Poses) -> Iterator[Doubt]:
    """Doubt poses that moved farther than they are said to be wrong.

    Which are right is not known: views that agree may be wrong alike, and the one that is held too.
    """
    others = [number for number in range(len(views)) if number != len(views) // 2]
    if not others:
        return
    nodes = np.concatenate([chain.points for chain in found.chains])
    middle, radius = nodes.mean(axis=0), min(chain.radius for chain in found.chains)
    reported = np.array([views[number].pose for number in others])
    motions = np.array([found.poses[number] for number in others]) @ np.linalg.inv(reported)
    shifts = motions[:, :3, :3] @ middle + motions[:, :3, 3] - middle
    turns = np.array([rotation_vector(motion[:3, :3]) for motion in motions])
    rotated, shifted = ((of**2).sum(axis=1) for of in (turns, shifts))
    squares = rotated / prior.rotation_sd**2 + shifted / prior.translation_sd**2
    rare = max(
        deviate(float(squares.sum()), _POSE * len(others)),
        # the greatest of several
        deviate(float(squares.max()), _POSE) - 0.5 * math.log(len(others)),
    )
    if rare <= _CHANCE:
        return
    # |(R - 1) x + t|
    away = nodes @ (motions[:, :3, :3] - np.eye(3)).transpose(0, 2, 1) + motions[:, None, :3, 3]
    far = math.sqrt(float((away**2).sum(axis=2).max()))
    # an error that is small against the ropes leaves the answer right
    share = min(max((far / radius - _SMALL[0]) / (_SMALL[1] - _SMALL[0]), 0.0), 1.0)
    reason = (
        f"registration moved views by up to {far * 1e3:.1f} mm, reported poses are said to be right to "
        f"{prior.translation_sd * 1e3:.1f} mm and {math.degrees(prior.rotation_sd):.1f} degrees; poses, "
        "intrinsics or depths may be wrong"
    )
    yield Doubt("pose", _CORRECTED * share * (rare - _CHANCE), "where the ropes are", reason)


def _of_range(chains: Sequence[Chain], bounds: Box) -> Iterator[Doubt]:
    """Doubt ropes whose axis leaves the range that was said to hold them."""
    outside = [~bounds.holds(chain.points, _OUTSIDE * chain.radius) for chain in chains]
    share = float(np.concatenate(outside).mean())
    reason = (
        f"{share:.0%} of the ropes' axes lie outside the extraction range, which should hold the ropes; "
        "depths or poses may be wrong, or the range"
    )
    yield Doubt("range", _OUT * share, "where the ropes are", reason)


def _of_views(views: Sequence[View], found: Found) -> Iterator[Doubt]:
    """Doubt what a view saw through, and ropes of which most pixels are lost."""
    worst, where, shown, lost = 0.0, -1, 0, 0
    for number, (view, pose) in enumerate(zip(views, found.poses, strict=True)):
        behind = np.concatenate([depth_behind(view, pose, chain) for chain in found.chains])
        # comparisons with NaN are false
        missed = int(np.count_nonzero(behind == np.inf))
        returned = int(np.count_nonzero(behind < np.inf))
        shown, lost = shown + returned, lost + missed
        through = int(np.count_nonzero(behind > _BEHIND)) - missed
        if returned >= _FEWEST and through / returned > worst:
            worst, where = through / returned, number
    reason = (
        f"a view, number {where} of those used, saw through {worst:.0%} of the ropes; it may be of something "
        "else, or its pose wrong, such as world-to-camera"
    )
    yield Doubt("view", _THROUGH * max(worst - _SEEN_THROUGH, 0.0), "of the ropes found", reason)
    share = lost / max(shown + lost, 1)
    reason = f"{share:.0%} of the pixels that should show the ropes have no depth"
    yield Doubt("points", _LOST * max(share - _USUALLY_LOST, 0.0), "where the ropes end", reason)


def depth_behind(view: View, pose: Array, chain: Chain) -> Array:
    """Return how far behind a rope's surface a view saw something.

    Parameters
    ----------
    view : View
        With all that it saw.
    pose : (4, 4) ndarray
        Camera to world.
    chain : Chain

    Returns
    -------
    (M,) ndarray
        For each node, in radii along the camera's axis; negative before the surface, infinite where its pixel
        has no return, NaN where it is in no image.
    """
    image = view.image
    if image is None:
        return np.full(len(chain.points), np.nan)
    behind = _core.seen_behind(image.depth, image.camera, pose, chain.points, chain.radius)
    return np.asarray(behind / chain.radius + 1.0)
