"""Errors that all pixels of a view share, and that an answer contradicts."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, norm

import strand
from shared.ropes import find_warnings
from strand.config import Config
from strand.reconstruction.evidence.confidence import to_normal_deviate
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Found, Observed
from strand.reconstruction.systematic import doubt_shared_errors, measure_depth_behind
from strand.ropes.chain import Chain
from strand.synthetic import render_depth
from strand.views.pose import make_rotation

KINDS = {"pose", "range", "view", "residuals", "radius"}


@pytest.fixture(scope="module")
def scene():
    return strand.synthetic.scene("s", seed=1, views=3, noise=strand.synthetic.Noise(depth=0.3e-3))


@pytest.fixture(scope="module")
def model(scene):
    return strand.reconstruct(scene.views, scene.radius, scene.bounds)


def answered(scene, views):
    """What the doubts are asked about: the truth as answer, at the reported poses."""
    observed = Observed(
        views,
        views,
        range(len(views)),
        None,
        Radii.from_caller(scene.radius),
        Prior.from_caller(1, None, None),
    )
    chains = [Chain(nodes, scene.radius) for nodes in scene.truth]
    poses = [view.pose for view in views]
    return observed, Found(chains, poses, [np.zeros(6)] * len(views), {})


def amounts(found):
    """Amounts by kind."""
    return {doubt.kind: doubt.amount for doubt in found}


def at(scene, poses, depth=None):
    """The scene's views at other poses, or with other depths, metres."""
    images = scene.depth * scene.depth_scale if depth is None else depth
    return [
        strand.View.from_depth(image, scene.intrinsics, pose)
        for image, pose in zip(images, poses, strict=True)
    ]


def test_where_nothing_is_wrong_there_is_no_such_doubt(model):
    assert not {doubt.kind for doubt in model.doubts} & KINDS
    assert not {warning.kind for warning in model.warnings} & KINDS
    assert model.confidence > 0.95


def test_poses_that_moved_farther_than_they_are_known_are_doubted(scene, model):
    poses = scene.poses.copy()
    poses[0, :3, 3] += [0.0, 0.01, 0.0]
    wrong = strand.reconstruct(at(scene, poses), scene.radius, scene.bounds)
    (doubt,) = [doubt for doubt in wrong.doubts if doubt.kind == "pose"]
    assert doubt.amount > 0.2
    assert wrong.confidence < 0.9 < model.confidence
    assert [warning.amount for warning in find_warnings(wrong, "pose")] == [doubt.amount]
    loose = Config(poses=strand.config.Poses(translation_sd=0.02))
    right = strand.reconstruct(at(scene, poses), scene.radius, scene.bounds, config=loose)
    assert not [doubt for doubt in right.doubts if doubt.kind == "pose"]


@pytest.mark.parametrize("by", [0.0, 0.5, 2.0])
def test_corrections_count_over_their_prior(scene, by):
    """Turns and shifts of the prior's size are none of a doubt, twice that in all directions is."""
    observed, found = answered(scene, at(scene, scene.poses_true))
    prior = Config().poses
    middle = found.chains[0].points.mean(axis=0)
    motion = np.eye(4)
    motion[:3, :3] = make_rotation(np.array([0.0, 0.0, 1.0]), by * prior.rotation_sd)
    motion[:3, 3] = middle - motion[:3, :3] @ middle + by * prior.translation_sd * np.array([1.0, 1.0, 1.0])
    moved = replace(found, poses=[motion @ found.poses[0], found.poses[1], motion @ found.poses[2]])
    amount = amounts(doubt_shared_errors(observed, moved, Config())).get("pose", 0.0)
    assert (amount > 0.1) == (by == 2.0)
    if by < 2.0:
        assert amount == 0.0
    # thick ropes are right all the same
    thick = [Chain(chain.points, 3.0 * scene.radius) for chain in moved.chains]
    assert (
        amounts(doubt_shared_errors(observed, replace(moved, chains=thick), Config())).get("pose", 0.0) == 0.0
    )


def test_depth_that_is_off_is_doubted(scene):
    for depth in (lambda z: z + 5e-3, lambda z: 1.015 * z):
        images = scene.depth * scene.depth_scale
        views = at(scene, scene.poses, np.where(images > 0, depth(images), 0.0))
        wrong = strand.reconstruct(views, scene.radius, scene.bounds)
        assert {doubt.kind for doubt in wrong.doubts} & KINDS
        assert wrong.confidence < 0.9


def test_ropes_outside_of_the_range_are_doubted(scene):
    observed, found = answered(scene, at(scene, scene.poses_true))
    inside = replace(observed, bounds=strand.Box(*scene.bounds))
    assert amounts(doubt_shared_errors(inside, found, Config()))["range"] == 0.0
    low, high = scene.bounds
    above = replace(observed, bounds=strand.Box([*low[:2], 1.2 * scene.radius], high))
    assert amounts(doubt_shared_errors(above, found, Config()))["range"] > 0.15


def test_a_view_that_saw_through_the_ropes_is_doubted(scene):
    views = at(scene, scene.poses_true)
    observed, found = answered(scene, views)
    right = amounts(doubt_shared_errors(observed, found, Config()))
    assert right["view"] == right["points"] == 0.0
    size = scene.depth.shape[:0:-1]
    table = render_depth([scene.truth[0]], 1e-6, scene.intrinsics, scene.poses_true[2], size)
    foreign = strand.View.from_depth(table, scene.intrinsics, scene.poses_true[2])
    observed, found = answered(scene, [*views[:2], foreign])
    (doubt,) = [doubt for doubt in doubt_shared_errors(observed, found, Config()) if doubt.kind == "view"]
    assert doubt.amount > 1.0
    assert "view 2 saw" in doubt.reason


@pytest.mark.parametrize(
    ("step", "pose_error", "doubted"), [(0.0, 0.0, True), (5.0, 0.0, False), (5.0, 12.0, True)]
)
def test_a_view_did_not_see_through_ropes_that_are_thinner_than_its_steps(scene, step, pose_error, doubted):
    # depths of the table alone, in steps of some radii
    size = scene.depth.shape[:0:-1]
    table = render_depth([scene.truth[0]], 1e-6, scene.intrinsics, scene.poses_true[2], size)
    rope = (
        render_depth(scene.truth, scene.radius, scene.intrinsics, scene.poses_true[2], size, table=False) > 0
    )
    depth = table + pose_error * scene.radius
    if step:
        depth = np.round(depth / (step * scene.radius)) * step * scene.radius
    view = strand.View.from_depth(depth, scene.intrinsics, scene.poses_true[2], mask=rope)
    observed, found = answered(scene, [view])
    assert (amounts(doubt_shared_errors(observed, found, Config()))["view"] > 0.3) == doubted


def test_pixels_without_a_return_are_doubted_where_they_are_most(scene):
    lost = np.random.default_rng(0).random(scene.depth.shape) < 0.85
    views = at(scene, scene.poses_true, np.where(lost, 0.0, scene.depth * scene.depth_scale))
    observed, found = answered(scene, views)
    assert 0.1 < amounts(doubt_shared_errors(observed, found, Config()))["points"] < 0.3


def test_depth_behind_a_rope_is_told_in_radii(scene):
    chain = Chain(scene.truth[0], scene.radius)
    (view, *_) = at(scene, scene.poses_true)
    near = measure_depth_behind(view, scene.poses_true[0], chain.points, chain.radius)
    assert abs(np.median(near)) < 0.3
    bare = strand.View(view.points)
    assert np.isnan(measure_depth_behind(bare, scene.poses_true[0], chain.points, chain.radius)).all()


@pytest.mark.parametrize("freedom", [3, 8, 24])
def test_deviates_are_those_of_a_chi_square(freedom):
    for square in (0.5 * freedom, freedom, 2.5 * freedom):
        expected = norm.isf(chi2.sf(square, freedom))
        assert math.isclose(to_normal_deviate(square, freedom), expected, abs_tol=0.1)
