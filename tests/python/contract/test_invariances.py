"""Answers do not depend on frame, scale, order of views and points, threads, and far points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import strand
from lib.measure import measure_chains
from strand import View
from strand.views.pose import make_rotation

# moved points are rounded differently, and searches end earlier or later, which moves ends most
NEAR = 0.1  # radii: greatest distance between nodes
SURE = 0.1  # greatest difference of confidences


@dataclass(frozen=True)
class Case:
    """A scene, its views and configuration, and its answer."""

    scene: strand.synthetic.SyntheticScene
    views: tuple[View, ...]
    config: strand.Config
    model: strand.Model

    def again(self, views, radius=None, bounds=None, **more):
        radius = self.scene.radius if radius is None else radius
        bounds = self.scene.bounds if bounds is None else bounds
        return strand.reconstruct(views, radius, bounds, config=self.config, **more)


def make_case(scene, views, config):
    model = strand.reconstruct(views, scene.radius, scene.bounds, config=config)
    assert model.chains
    return Case(scene, tuple(views), config, model)


@pytest.fixture(scope="module", params=["tubes", "two", "published", "images"])
def case(request):
    if request.param == "tubes":
        scene = strand.synthetic.scene("overhand", seed=2, views=3)
        return make_case(scene, scene.views, strand.Config())
    if request.param == "two":
        chains = strand.synthetic.random_ropes(2, 2, seed=5)
        scene = strand.synthetic.scene(chains=chains, seed=5, views=3)
        return make_case(scene, scene.views, strand.Config())
    if request.param == "published":
        scene = strand.synthetic.scene("arc", seed=3, views=3)
        return make_case(scene, scene.views, strand.Config.published())
    scene = strand.synthetic.scene("loop", seed=5, camera=strand.synthetic.Camera("d405"), views=1)
    return make_case(scene, scene.views, strand.Config())


def make_view(scene, number, pose, scale=1.0):
    mask = None if scene.mask is None else scene.mask[number]
    depth = scene.depth[number] * (scene.depth_scale * scale)
    return View.from_depth(depth, scene.intrinsics, pose, mask=mask)


def measure_difference(some, others, radius):
    """Return the greatest distance between two models' ropes, in radii, in either direction."""
    assert len(some.chains) == len(others.chains)
    assert [chain.closed for chain in some.chains] == [chain.closed for chain in others.chains]
    worst = 0.0
    for one, other in zip(some.chains, others.chains, strict=True):
        at = np.linspace(0.0, 1.0, 101)
        mine, theirs = one.at(at * one.length), other.at(at * other.length)
        worst = max(worst, min(np.abs(mine - way).max() for way in (theirs, theirs[::-1])))
    return worst / radius


def assert_same_ropes(model, case, motion=None, scale=1.0, near=NEAR):
    """Assert that a model is the case's after a motion of the world, at a scale."""
    motion = np.eye(4) if motion is None else motion
    back = np.linalg.inv(motion)
    chains = [
        strand.Chain(
            (chain.points @ back[:3, :3].T + back[:3, 3]) / scale, chain.radius / scale, chain.closed
        )
        for chain in model.chains
    ]
    returned = strand.Model(chains, case.model.poses)
    plain = [strand.Chain(chain.points, chain.radius, chain.closed) for chain in case.model.chains]
    assert measure_difference(returned, strand.Model(plain, case.model.poses), case.scene.radius) < near
    if not np.isnan(model.confidence):
        assert model.confidence == pytest.approx(case.model.confidence, abs=SURE)


@pytest.mark.parametrize("seed", range(2))
def test_the_world_frame_does_not_matter(case, seed):
    rng = np.random.default_rng(seed)
    motion = np.eye(4)
    # bounds stay a box along the axes only after quarter turns
    motion[:3, :3] = make_rotation(np.eye(3)[seed], 0.5 * np.pi).round()
    motion[:3, 3] = rng.uniform(-3.0, 3.0, 3)
    corners = np.array(case.scene.bounds) @ motion[:3, :3].T + motion[:3, 3]
    views = [view.moved(motion) for view in case.views]
    model = case.again(views, bounds=(corners.min(axis=0), corners.max(axis=0)))
    assert_same_ropes(model, case, motion)


@pytest.mark.parametrize("scale", [0.1, 25.0])
def test_the_scale_does_not_matter(case, scale):
    views = []
    for number, view in enumerate(case.views):
        pose = view.pose.copy()
        pose[:3, 3] *= scale
        views.append(make_view(case.scene, number, pose, scale))
    bounds = tuple(scale * np.array(corner) for corner in case.scene.bounds)
    config = case.config
    # what is known of poses is in metres
    config = strand.Config(
        method=config.method,
        poses=strand.config.Poses(
            rotation_sd=config.poses.rotation_sd, translation_sd=scale * config.poses.translation_sd
        ),
    )
    model = strand.reconstruct(views, scale * case.scene.radius, bounds, config=config)
    assert_same_ropes(model, case, scale=scale)


def test_the_order_of_views_does_not_matter_if_the_middle_one_stays(case):
    model = case.again(case.views[::-1])
    assert_same_ropes(model, case)


def test_the_order_of_points_does_not_matter(case):
    rng = np.random.default_rng(0)
    views = [view.crop(case.scene.bounds) for view in case.views]
    one, other = (
        case.again([View(view.points[order(len(view.points))], view.pose) for view in views])
        for order in (np.arange, rng.permutation)
    )
    if min(one.confidence, other.confidence) < 0.9:
        # images show the noise, points do not
        assert max(one.confidence, other.confidence) < 0.95
        return
    # the order of points decides which points of a crowd are used
    assert measure_difference(one, other, case.scene.radius) < 2 * NEAR


def test_a_mirrored_scene_has_mirrored_ropes_and_crossings(case):
    mirror = np.diag([1.0, -1.0, 1.0])
    views = []
    for view in case.views:
        # a camera that is mirrored too, with columns the other way round, sees the same pixels
        pose = view.pose.copy()
        pose[:3, :3] = mirror @ pose[:3, :3] @ np.diag([-1.0, 1.0, 1.0])
        pose[:3, 3] = mirror @ pose[:3, 3]
        views.append(View(view.crop(case.scene.bounds).points * [-1.0, 1.0, 1.0], pose))
    plain = [View(view.crop(case.scene.bounds).points, view.pose) for view in case.views]
    low, high = case.scene.bounds
    bounds = low * [1, 1, 1], high * [1, 1, 1]
    bounds[0][1], bounds[1][1] = -high[1], -low[1]
    direct, model = case.again(plain), case.again(views, bounds=bounds)
    if direct.confidence < 0.5:
        assert model.confidence < 0.9
        return
    assert len(model.chains) == len(direct.chains)
    mirrored = strand.Model(
        [strand.Chain(chain.points @ mirror, chain.radius, chain.closed) for chain in model.chains],
        model.poses,
    )
    unmirrored = [strand.Chain(chain.points, chain.radius, chain.closed) for chain in direct.chains]
    assert measure_difference(mirrored, strand.Model(unmirrored, direct.poses), case.scene.radius) < 3 * NEAR
    truth, radius = case.scene.truth, case.scene.radius
    right = measure_chains([chain.points for chain in direct.chains], truth, radius).crossings
    turned = measure_chains(
        [chain.points for chain in model.chains], [nodes @ mirror for nodes in truth], radius
    )
    assert (turned.crossings.right, turned.crossings.found) == (right.right, right.found)


def test_points_far_outside_the_bounds_do_not_matter(case):
    rng = np.random.default_rng(1)
    far = rng.normal(size=(2000, 3)) * 0.1 + [40.0, -30.0, 20.0]
    plain = [view.crop(case.scene.bounds) for view in case.views]
    views = [
        View(np.concatenate([view.points, (far - view.viewpoint) @ view.pose[:3, :3]]), view.pose)
        for view in plain
    ]
    # rays to the far cluster pass beside the ropes
    assert measure_difference(case.again(plain), case.again(views), case.scene.radius) < 1e-6


def test_the_number_of_threads_changes_no_bit(case, threads):
    threads(3)
    model = case.again(case.views)
    assert [chain.points.tobytes() for chain in model.chains] == [
        chain.points.tobytes() for chain in case.model.chains
    ]
    assert model.poses.tobytes() == case.model.poses.tobytes()
    assert np.array_equal(model.confidence, case.model.confidence, equal_nan=True)
