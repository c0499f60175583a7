"""Reconstructions from more views than are solved by factors alone."""

from __future__ import annotations

import numpy as np
import pytest

import strand

VIEWS = 36  # poses of more than 31 views are solved by iterations
MAX_ERROR = 1.5e-3  # metres, of the median node: the reported pose of the held view is as wrong


@pytest.mark.parametrize("masked", [False, True])
def test_many_views_are_registered_together(masked):
    mask = strand.synthetic.Segmentation() if masked else None
    scene = strand.synthetic.scene(seed=5, views=VIEWS, mask=mask)
    views = scene.views
    if masked:
        images = zip(scene.depth, scene.poses, scene.mask, strict=True)
        views = [
            strand.View.from_depth(depth, scene.intrinsics, pose, depth_scale=scene.depth_scale, mask=own)
            for depth, pose, own in images
        ]
    model = strand.reconstruct(views, radius=scene.radius)
    assert len(model.chains) == len(scene.truth) == 1
    truth = np.asarray(scene.truth[0])
    away = np.linalg.norm(model.chains[0].points[:, None] - truth[None], axis=2).min(axis=1)
    assert np.median(away) < MAX_ERROR
    assert len(model.poses) == VIEWS
    # the held view moves all others by the error of its pose
    assert measure_spread(model.poses, scene) < 0.5 * measure_spread(scene.poses, scene)


def measure_spread(poses, scene) -> float:
    """Return the median distance of the views' errors from their mean, metres."""
    errors = np.array([(pose - true)[:3, 3] for pose, true in zip(poses, scene.poses_true, strict=True)])
    return float(np.median(np.linalg.norm(errors - errors.mean(axis=0), axis=1)))
