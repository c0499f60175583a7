"""Where ropes end."""

from __future__ import annotations

import numpy as np

import strand


def test_deviations_of_ends_are_true():
    normalized = []
    for name in ("s", "arc", "straight"):
        for seed in range(3):
            scene = strand.synthetic.scene(name, seed=seed)
            (chain,) = strand.reconstruct(scene.views, scene.radius, scene.bounds).chains
            for node, covariance, outward in (
                (chain.points[0], chain.covariance[0], -chain.tangents[0]),
                (chain.points[-1], chain.covariance[-1], chain.tangents[-1]),
            ):
                true = min(scene.truth[0][[0, -1]], key=lambda end: np.linalg.norm(end - node))
                normalized.append(outward @ (node - true) / np.sqrt(outward @ covariance @ outward))
    assert 0.4 < np.sqrt(np.mean(np.square(normalized))) < 2.0
