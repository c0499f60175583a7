"""Which end of a chain is its start."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from shared.ropes import R


def test_chains_start_at_the_same_end_however_the_data_waver(paper, paper_model):
    start = paper_model.chains[0].points[0]
    for seed in range(2):
        other = strand.synthetic.scene(
            chains=paper.truth, seed=seed, noise=strand.synthetic.Noise(depth=0.0005)
        )
        chain = strand.reconstruct(other.views, other.radius, other.bounds).chains[0]
        assert np.linalg.norm(chain.points[0] - start) < 2.0 * R
    before = dataclasses.replace(paper_model, chains=(paper_model.chains[0].reversed(),))
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, previous=before)
    np.testing.assert_allclose(model.chains[0].points, before.chains[0].points, atol=1e-9)
    with pytest.raises(TypeError, match="previous"):
        strand.reconstruct(paper.views, paper.radius, paper.bounds, previous="before")


def test_rings_start_at_the_same_place_however_the_data_waver():
    angle = np.linspace(0.0, 2.0 * np.pi, 315)
    ring = 0.05 * np.stack([np.cos(angle), np.sin(angle), np.zeros(315)], axis=1) + [0.0, 0.0, R]
    starts = []
    for seed in range(3):
        scene = strand.synthetic.scene(chains=[ring], seed=seed)
        chain = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains[0]
        assert chain.closed
        starts.append(chain.points[0])
    assert np.ptp(starts, axis=0).max() < 3.0 * R
