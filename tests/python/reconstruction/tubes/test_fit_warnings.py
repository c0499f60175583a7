"""Warnings about a fit of tubes."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import find_warnings


@pytest.mark.parametrize("factor", [0.8, 0.9, 1.1, 1.2])
def test_a_radius_that_the_points_contradict_is_warned_about(paper, paper_model, factor):
    assert find_warnings(paper_model, "radius") == []
    model = strand.reconstruct(paper.views, factor * paper.radius, paper.bounds)
    (warning,) = find_warnings(model, "radius")
    # the fitted radius is at most a little beyond the true one
    assert 0.0 < warning.amount / (paper.radius - factor * paper.radius) < 1.5
    assert ("thicker" if factor < 1.0 else "thinner") in str(warning)


def test_noise_that_the_residuals_contradict_is_warned_about(paper):
    config = strand.Config(tubes=strand.config.Tubes(noise=1e-5))
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, config=config, keep_stages=True)
    (warning,) = find_warnings(model, "noise")
    assert warning.amount == pytest.approx(model.stages["fit"].sigma / 1e-5)
    assert warning.amount > 30.0


def test_directions_that_the_points_leave_open_stay_as_reported():
    scene = strand.synthetic.scene("straight", seed=2)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    along = np.diff(scene.truth[0][[0, -1]], axis=0)[0]
    along /= np.linalg.norm(along)
    for given, found, sd in zip(scene.poses, model.poses, model.pose_sd, strict=True):
        moved = (found @ np.linalg.inv(given)) @ [*scene.truth[0].mean(axis=0), 1.0]
        assert abs((moved[:3] - scene.truth[0].mean(axis=0)) @ along) < 2e-3
        assert sd.max() < 1.01 * max(strand.Config().poses.rotation_sd, strand.Config().poses.translation_sd)
    poses = find_warnings(model, "open pose")
    assert poses
    limits = np.repeat([strand.Config().poses.rotation_sd, strand.Config().poses.translation_sd], 3)
    for warning in poses:
        assert warning.amount == pytest.approx((model.pose_sd[warning.view] / limits).max())
        assert 0.8 < warning.amount < 1.01
