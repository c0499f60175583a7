"""Registration of views by tubes."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import R, sample_tube
from strand.reconstruction.outliers import drop_outliers


def test_opposite_views_do_not_pull_into_each_other():
    """Point-to-point ICP fails on opposite views of a straight tube, even from right poses."""
    axis = np.array([[-0.15, 0.0, 0.0], [0.15, 0.0, 0.0]])
    cameras = np.array([[0.0, -0.4, 0.1], [0.0, 0.4, 0.1]])
    views = [
        strand.View.from_world(sample_tube(axis, camera, 3e-4, seed), camera)
        for seed, camera in enumerate(cameras)
    ]
    poses, sd = strand.register_views(views, R)
    turn, center = poses[0][:3, :3], np.array([0.0, 0.0, 0.0])
    shift = turn @ (center - views[0].viewpoint) + poses[0][:3, 3]
    assert np.abs(shift[1:]).max() < 1e-4
    # along the rope only the prior counts: the pose stays within it, and its deviation says so
    assert abs(shift[0]) < sd[0, 3]
    assert sd[0, 3] > 0.8 * strand.Config().poses.translation_sd
    assert sd[0, 4:].max() < 0.05 * sd[0, 3]
    icp = strand.icp(views[0].world_points, views[1].world_points, 2 * R)
    assert np.abs(icp.transformation[1:3, 3]).max() > 1e-3


def test_registration_finds_the_poses_and_their_deviations(paper):
    cropped = [view.crop(paper.bounds) for view in paper.views]
    views = drop_outliers(cropped, R, strand.Config().filter, published=False)
    poses, sd = strand.register_views(views, R)
    nodes = paper.truth[0]
    for number, (given, found, true) in enumerate(zip(paper.poses, poses, paper.poses_true, strict=True)):
        off = {}
        for name, pose in (("given", given), ("found", found)):
            motion = pose @ np.linalg.inv(true)
            off[name] = np.sqrt(((nodes @ motion[:3, :3].T + motion[:3, 3] - nodes) ** 2).sum(axis=1).mean())
        if number == 3:
            np.testing.assert_allclose(found, given, atol=1e-12)
            assert (sd[number] == 0).all()
        else:
            assert off["found"] < 0.3e-3 < off["given"]
            assert (sd[number] > 0).all()
            assert sd[number][3:].max() < 0.3e-3


def test_straight_ropes_slide_less_than_their_poses_were_wrong():
    given, found, normalized = [], [], []
    for seed in range(5):
        scene = strand.synthetic.scene("straight", seed=seed)
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, keep_stages=True)
        nodes = scene.truth[0]
        along = (nodes[-1] - nodes[0]) / np.linalg.norm(nodes[-1] - nodes[0])
        for number, covariance in enumerate(model.stages["fit"].pose_covariance):
            slides = []
            for pose in (scene.poses[number], model.poses[number]):
                motion = pose @ np.linalg.inv(scene.poses_true[number])
                slides.append(along @ (nodes @ motion[:3, :3].T + motion[:3, 3] - nodes).mean(axis=0))
            if number != 3:
                given.append(slides[0])
                found.append(slides[1])
                normalized.append(slides[1] / np.sqrt(along @ covariance[3:, 3:] @ along))
    assert np.sqrt(np.mean(np.square(found))) < 0.7 * np.sqrt(np.mean(np.square(given)))
    assert 0.6 < np.sqrt(np.mean(np.square(normalized))) < 1.6


def test_registration_checks_its_arguments(paper):
    with pytest.raises(TypeError, match=r"views\[0\]"):
        strand.register_views([5], R)
    with pytest.raises(ValueError, match="views"):
        strand.register_views([], R)
    with pytest.raises(ValueError, match="radius"):
        strand.register_views(paper.views, -1.0)
    with pytest.raises(TypeError, match="config"):
        strand.register_views(paper.views, R, config=5)
