"""One hand-eye error in all poses is found and corrected; right poses and single errors are left alone."""

from __future__ import annotations

import math

import numpy as np

import strand
from strand.synthetic import Noise, random_ropes, scene

R = 4.5e-3
MADE = scene(chains=random_ropes(1, 1, R, 10), radius=R, seed=10, noise=Noise(depth=0.1 * R), views=3)
ERROR = strand.pose_from_angles(math.radians(0.7), math.radians(-0.5), 0.0, [2e-3, -1.5e-3, 1e-3])


def reconstruct(poses):
    depth = MADE.depth * MADE.depth_scale
    views = [strand.View.from_depth(z, MADE.intrinsics, pose) for z, pose in zip(depth, poses, strict=True)]
    return strand.reconstruct(views, R, MADE.bounds)


def names_hand_eye(model):
    return any("one hand-eye error of" in str(warning) for warning in model.warnings)


def measure_error(model):
    truth = MADE.truth[0]
    away = np.linalg.norm(model.chains[0].points[:, None] - truth[None], axis=2).min(axis=1)
    return float(np.sqrt((away**2).mean())) / R


def test_a_hand_eye_error_is_named_and_corrected():
    model = reconstruct(MADE.poses @ ERROR)
    assert names_hand_eye(model)
    assert measure_error(model) < 0.5


def test_right_poses_are_left_alone():
    assert not names_hand_eye(reconstruct(MADE.poses))
    aside = MADE.poses.copy()
    aside[-1, :3, 3] += [4e-3, 4e-3, 0.0]
    assert not names_hand_eye(reconstruct(aside))
