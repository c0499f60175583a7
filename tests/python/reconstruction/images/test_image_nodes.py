"""Poses that an image fit corrects."""

from __future__ import annotations

import numpy as np
import pytest

from strand.reconstruction.images.image_nodes import correct_poses
from strand.synthetic import Camera, Segmentation, scene

SCENE = scene("loop", seed=2, views=3, camera=Camera("zed"), mask=Segmentation())


def test_corrections_of_frames_move_points_by_their_vectors():
    rng = np.random.default_rng(3)
    poses = [pose for pose in SCENE.poses]
    corrections = rng.normal(scale=[[0.02] * 3 + [0.003] * 3], size=(3, 6))
    corrections[1] = 0.0
    points = rng.normal(size=(50, 3))
    corrected = correct_poses(poses, corrections)
    assert np.array_equal(corrected[1], poses[1])
    for pose, after, (*turn, x, y, z) in zip(poses, corrected, corrections, strict=True):
        assert after[:3, :3] @ after[:3, :3].T == pytest.approx(np.eye(3), abs=1e-12)
        before = (points - pose[:3, 3]) @ pose[:3, :3]
        now = (points - after[:3, 3]) @ after[:3, :3]
        # to first order; the second is half the square of the angle
        first = before + np.cross(turn, before) + [x, y, z]
        assert np.abs(now - first).max() <= np.linalg.norm(turn) ** 2 * np.abs(before).max() + 1e-12
