"""One error in the hand-eye matrix, the same for all views: solve for it from registration's corrections.

With reported poses P, the true ones are P X. Registration holds the pose of view h, so that it finds
P_h X^-1 P_h^-1 P X: the ropes are off by the error of the held view. To first order in X, the corrections are
linear in its rotation vector and translation (Park and Martin 1994 solve AX = XB for large ones).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.config import Poses
from strand.reconstruction.evidence.confidence import to_normal_deviate
from strand.reconstruction.stages import Found, Observed
from strand.support.checks import Array
from strand.views.pose import make_rotation, measure_motions

_MIN_VIEWS = 3  # two views leave nothing that would contradict a hand-eye error
_MIN_DEVIATE = 2.5  # standard normal deviate: rarer corrections are more than chance
_POSE_FREEDOM = 4  # unknowns of a pose that its error may have moved
_MAX_LEFT = 0.2  # share of the squared corrections that a hand-eye error may leave
_MAX_SURPRISE = 12.0  # chi-square of the hand-eye error: greater ones are other mistakes
_ERROR_SD = (math.radians(1.0), 4e-3)  # radians and metres: usual hand-eye errors, each component
_FLOOR_SD = (math.radians(0.1), 3e-4)  # radians and metres: error of corrections beyond their deviations
_MAX_OTHER_DOUBT = 5.0  # a doubt this great names another mistake


@dataclass(frozen=True, eq=False)
class HandEyeError:
    """An error X of a hand-eye matrix: the true poses are the reported ones times X.

    Attributes
    ----------
    motion : (4, 4) ndarray
    reason : str
        Its size in words.
    """

    motion: Array
    reason: str


def find_hand_eye_error(observed: Observed, found: Found, prior: Poses) -> HandEyeError | None:
    """Return the hand-eye error that explains corrections of poses; None if these are small or disagree."""
    held, count = observed.held, len(found.poses)
    if count < _MIN_VIEWS or found.doubts is None or not np.isfinite(found.pose_sd).all():
        return None
    if any(doubt.amount >= _MAX_OTHER_DOUBT for doubt in found.doubts):
        return None
    reported = [view.pose for view in observed.views]
    center = np.concatenate([chain.points for chain in found.chains]).mean(axis=0)
    expected = np.repeat([prior.rotation_sd, prior.translation_sd], 3)
    others = [k for k in range(count) if k != held]
    motions = np.array(found.poses)[others] @ np.linalg.inv(np.array(reported)[others])
    moved = measure_motions(motions, center)
    surprise = sum(((moved / expected) ** 2).sum(axis=1).tolist())
    if to_normal_deviate(surprise, _POSE_FREEDOM * len(others)) <= _MIN_DEVIATE:
        return None
    still = _move_center(reported[held], center)
    rows, targets = [], []
    for k, correction in zip(others, moved, strict=True):
        deviation = np.hypot(found.pose_sd[k], np.repeat(_FLOOR_SD, 3))
        rows.append((_move_center(reported[k], center) - still) / deviation[:, None])
        targets.append(correction / deviation)
    matrix, target = np.vstack(rows), np.concatenate(targets)
    # directions that the rotations between views leave open stay small
    likely = np.diag(1.0 / np.repeat(_ERROR_SD, 3))
    error = np.linalg.lstsq(np.vstack([matrix, likely]), np.append(target, np.zeros(6)), rcond=None)[0]
    left = float(((matrix @ error - target) ** 2).sum())
    if left > _MAX_LEFT * float(target @ target) or float(((likely @ error) ** 2).sum()) > _MAX_SURPRISE:
        return None
    angle, away = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
    motion = np.eye(4)
    motion[:3, :3] = make_rotation(error[:3] / max(angle, np.finfo(float).tiny), angle)
    motion[:3, 3] = error[3:]
    reason = (
        f"one hand-eye error of {away * 1e3:.1f} mm and {math.degrees(angle):.1f} degrees, the same in all "
        "poses, explains how registration moved the views; poses are corrected by it: calibrate again"
    )
    return HandEyeError(motion, reason)


def _move_center(pose: Array, center: Array) -> Array:
    """(6, 6) Return the rotation vector and shift of a point for a small motion in the camera's frame."""
    turn, (x, y, z) = pose[:3, :3], center - pose[:3, 3]
    moves = np.zeros((6, 6))
    moves[:3, :3] = moves[3:, 3:] = turn
    moves[3:, :3] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn
    return moves
