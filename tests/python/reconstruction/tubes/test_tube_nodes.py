"""Nodes of chains."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from strand.geometry.curve import Curve
from strand.reconstruction.tubes.tube_nodes import make_chains


def test_chains_have_covariances_and_counts_and_keep_them_in_files(paper, tmp_path):
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds)
    (chain,) = model.chains
    count = len(chain.points)
    assert chain.covariance.shape == (count, 3, 3)
    assert (np.linalg.eigvalsh(chain.covariance) > 0).all()
    assert chain.points_seen.shape == chain.views_seen.shape == (count,)
    assert (chain.views_seen <= 7).all()
    assert np.median(chain.views_seen) >= 5
    np.testing.assert_allclose(chain.at(chain.arc_length), chain.points, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(chain.tangents, axis=1), 1.0, atol=1e-12)
    s = np.linspace(0.01, chain.length - 0.01, 7)
    near = chain.nearest(chain.at(s))
    np.testing.assert_allclose(near.s, s, atol=1e-6)
    assert near.distance.max() < 1e-9
    model.save(tmp_path / "model.json")
    loaded = strand.load_model(tmp_path / "model.json")
    np.testing.assert_array_equal(loaded.chains[0].covariance, chain.covariance)
    np.testing.assert_array_equal(loaded.chains[0].views_seen, chain.views_seen)
    np.testing.assert_array_equal(loaded.chains[0].at(0.1), chain.at(0.1))
    np.testing.assert_array_equal(loaded.pose_sd, model.pose_sd)


def test_deviations_of_nodes_are_true():
    values = []
    for seed in range(6):
        scene = strand.synthetic.scene("s", seed=seed)
        (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
        line = strand.Chain(scene.truth[0], scene.radius)
        for point, covariance in zip(chain.points[8:-8:4], chain.covariance[8:-8:4], strict=True):
            (s,) = line.nearest(point[None]).s
            _, _, axes = np.linalg.svd(np.atleast_2d(line.at(s + 1e-4) - line.at(s - 1e-4)))
            across = axes[1:]
            error = across @ (point - line.at(s))
            values.append(error @ np.linalg.solve(across @ covariance @ across.T, error) / 2)
    assert 0.5 < np.mean(values) < 2.0


def test_nodes_are_as_dense_as_the_configuration_says(paper):
    config = dataclasses.replace(strand.Config(), tubes=strand.config.Tubes(node_spacing=1.0))
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, config=config)
    assert len(model.chains[0].points) == pytest.approx(model.chains[0].length / paper.radius, rel=0.02)


def test_a_ring_of_hardly_any_length_is_no_chain(paper_model):
    fit, radius = paper_model.stages["fit"], paper_model.chains[0].radius
    curve, config = Curve.whole(fit.curves[0]), strand.Config()
    for length, count in ((0.3 * radius, 0), (20.0 * radius, 1)):
        part = curve.trimmed(10.0 * radius, 10.0 * radius + length)
        assert len(make_chains(fit, [part], [True], np.zeros(1), config)) == count
    short = curve.trimmed(10.0 * radius, 10.3 * radius)
    (chain,) = make_chains(fit, [short], [False], np.zeros(1), config)
    assert len(chain.points) == 2
