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
    errors = [
        np.linalg.norm((pose - true)[:3, 3]) for pose, true in zip(model.poses, scene.poses_true, strict=True)
    ]
    reported = [
        np.linalg.norm((pose - true)[:3, 3]) for pose, true in zip(scene.poses, scene.poses_true, strict=True)
    ]
    assert np.median(errors) <= np.median(reported)
