"""Tubes from views to chains."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import (
    CAMERA,
    R,
    draw_line,
    find_warnings,
    hide_behind_plate,
    measure_max_distance,
    sample_tube,
)
from strand.config import Config, Linking


@pytest.mark.parametrize("name", ["coil_0.7mm", "overhand_mid", "paper_mid", "heap00", "hard03", "two_ropes"])
def test_touching_strands_and_knots_come_out_whole(collected, name):
    scene = collected(name)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == len(scene.truth)
    for chain in model.chains:
        middle = chain.points[None, len(chain.points) // 2]
        truth = min(scene.truth, key=lambda t: strand.Chain(t, 0.01).nearest(middle).distance[0])
        line = strand.Chain(truth, scene.radius)
        near = line.nearest(chain.points)
        assert np.sqrt((near.distance**2).mean()) < 0.2e-3
        assert (np.diff(near.s) > -1e-3).all() or (np.diff(near.s) < 1e-3).all(), (
            "in order along the true rope"
        )
        assert chain.length == pytest.approx(line.length, rel=0.006)


@pytest.mark.parametrize("name", ["loop_1.5mm", "overhand_1.5mm"])
def test_strands_that_run_together_for_long_are_separated(collected, name):
    scene = collected(name)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    (chain,) = model.chains
    truth = strand.Chain(scene.truth[0], scene.radius)
    assert chain.length == pytest.approx(truth.length, rel=0.01)
    s = truth.nearest(chain.points).s
    assert (np.abs(np.diff(s)) < 4.0 * R).all(), "in order along the true rope"


def draw_two_in_line(gap):
    x = np.linspace(0.0, 0.1, 101)
    return [np.stack([side * (x + 0.5 * gap * R), 0.0 * x, np.full(101, R)], axis=1) for side in (-1.0, 1.0)]


@pytest.mark.parametrize("gap", [2.0, 3.0, 4.0])
def test_a_gap_that_cameras_see_through_is_not_bridged(gap):
    scene = strand.synthetic.scene(chains=draw_two_in_line(gap), seed=int(gap))
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds)
    assert len(model.chains) == 2
    # short chains are often pieces of one rope
    assert model.confidence > 0.6


def test_only_hidden_gaps_are_bridged():
    parts = [draw_line([-0.1, 0, R], [-0.03, 0, R]), draw_line([0.03, 0, R], [0.1, 0, R])]
    scene = strand.synthetic.scene(chains=parts, seed=1, views=3)
    for ropes in (None, 1):
        model = strand.reconstruct(scene.views, scene.radius, scene.bounds, ropes=ropes)
        assert model.chains[0].length < 0.08
    # without the table behind it, no camera saw through the gap
    views = [view.crop(scene.bounds) for view in scene.views]
    model = strand.reconstruct(views, scene.radius, ropes=1)
    (chain,) = model.chains
    assert chain.length == pytest.approx(0.2, rel=0.02)
    assert chain.bridged.mean() == pytest.approx(0.3, abs=0.04)
    middle = np.abs(chain.points[:, 0]) < 0.025
    assert chain.bridged[middle].all()
    assert np.abs(chain.points[middle, 1:] - [0.0, R]).max() < R


def reconstruct_rings(views, bounds, rings, **known):
    return strand.reconstruct(views, R, bounds, config=Config(linking=Linking(rings=rings)), **known)


def test_rings_are_closed_as_the_caller_says():
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    ring = np.stack([0.06 * np.cos(angle), 0.06 * np.sin(angle), 0 * angle + R], axis=1)
    scene = strand.synthetic.scene(chains=[ring], seed=1, views=3)
    for rings in ("maybe", "always"):
        (chain,) = reconstruct_rings(scene.views, scene.bounds, rings).chains
        assert chain.closed
        assert chain.length == pytest.approx(0.12 * np.pi, rel=0.01)
    (chain,) = reconstruct_rings(scene.views, scene.bounds, "never").chains
    assert not chain.closed
    # with a quarter hidden, the gap is too long to be bridged unless the rope is known to be a ring
    views = hide_behind_plate(scene, (-0.1, 0.0), (0.03, 0.1), 0.022)
    for rings in ("maybe", "never"):
        assert not reconstruct_rings(views, scene.bounds, rings).chains[0].closed
    for known in ({}, {"ropes": 1}, {"length": 0.12 * np.pi}):
        model = reconstruct_rings(views, scene.bounds, "always", **known)
        (chain,) = model.chains
        assert chain.closed
        assert chain.length == pytest.approx(0.12 * np.pi, rel=0.01)
        assert measure_max_distance(chain, ring) < 1.0


def test_a_rope_with_visible_ends_is_no_ring():
    scene = strand.synthetic.scene("arc", seed=1, views=3)
    sure = reconstruct_rings(scene.views, scene.bounds, "never")
    model = reconstruct_rings(scene.views, scene.bounds, "always")
    assert not model.chains[0].closed
    (warning,) = find_warnings(model, "ring")
    assert str(warning) == "chain 0 has ends, though all ropes are said to be rings"
    assert warning.chains == (0,)
    assert warning.amount == pytest.approx(np.log(2.0))
    assert model.confidence < 0.85 < sure.confidence


def test_very_dense_views_are_fitted_to_some_of_their_points():
    line = draw_line([-0.03, 0, R], [0.03, 0, R])
    points = np.concatenate([sample_tube(line, CAMERA, 0.1 * R, seed) for seed in range(400)])
    model = strand.reconstruct([strand.View.from_world(points, CAMERA)], R, keep_stages=True)
    (chain,) = model.chains
    assert measure_max_distance(chain, line) < 0.05
    taken = len(model.stages["registered"][0])
    assert 20_000 < taken < 0.6 * len(points)


def test_sparse_views_beside_very_dense_ones_keep_all_their_points():
    line = draw_line([-0.03, 0, R], [0.03, 0, R])
    dense = np.concatenate([sample_tube(line, CAMERA, 0.1 * R, seed) for seed in range(400)])
    sparse = sample_tube(line, CAMERA, 0.1 * R, 400)
    views = [strand.View.from_world(points, CAMERA) for points in (dense, sparse)]
    registered = strand.reconstruct(views, R, keep_stages=True).stages["registered"]
    assert len(registered[0]) < 0.6 * len(dense)
    assert len(registered[1]) > 0.95 * len(sparse)
