"""The outlier filter."""

from __future__ import annotations

import numpy as np

import strand
from shared.ropes import CAMERA, R, draw_line, sample_strip, sample_tube
from strand.config import Filter
from strand.reconstruction.outliers import drop_outliers


def test_a_coarse_view_keeps_its_edges():
    points = sample_strip(0.004)[::40]
    stray = np.array([[0.0, 0.05, 0.0]])
    view = strand.View.from_world(np.vstack([points, stray]), CAMERA)
    kept = drop_outliers([view], 0.004, Filter(), published=False)[0].world_points
    assert len(kept) > 0.9 * len(points)
    assert np.abs(kept[:, 1]).max() < 0.01
    assert len(drop_outliers([view], 0.004, Filter(widen_below=1.0), published=False)[0].points) < 0.7 * len(
        points
    )


def test_dense_views_lose_outliers_and_keep_ropes():
    line = draw_line([-0.1, 0, R], [0.1, 0, R])
    rope = np.concatenate([sample_tube(line, CAMERA, 0.1 * R, seed) for seed in range(60)])
    rng = np.random.default_rng(0)
    stray = rng.uniform([-0.1, 0.02, 0.0], [0.1, 0.1, 0.1], (200, 3))
    points = np.concatenate([stray, rope])
    order = rng.permutation(len(points))
    view = strand.View.from_world(points[order], CAMERA)
    kept = drop_outliers([view], R, Filter(), published=False)[0].world_points
    assert len(rope) > 100_000
    assert np.count_nonzero(kept[:, 1] > 0.015) == 0
    assert len(kept) > 0.99 * len(rope)


def test_dense_views_in_rows_keep_ropes():
    along, around = np.meshgrid(np.linspace(-0.2, 0.2, 16_000), np.linspace(0.0, np.pi, 32), indexing="ij")
    points = np.stack([along, 0.005 * np.cos(around), 0.005 * np.sin(around)], axis=-1).reshape(-1, 3)
    view = strand.View.from_world(points, (0.0, 0.0, 0.6))
    assert len(drop_outliers([view], 0.005, Filter(), published=False)[0].points) > 0.99 * len(points)


def test_dense_views_are_filtered_by_the_numbers_of_the_config():
    rng = np.random.default_rng(0)
    s, around = rng.uniform([-0.2, 0.0], [0.2, np.pi], (420_000, 2)).T
    thin = np.arange(len(s)) >= 400_000
    points = np.column_stack([s, 0.05 * thin + 0.005 * np.cos(around), 0.005 * np.sin(around)])
    views = [strand.View.from_world(rng.permutation(points), (0.0, 0.0, 0.6))]
    for config, least in ((Filter(min_neighbors=300), 0.95 * 400_000), (Filter(min_fraction=0.02), 415_000)):
        assert len(drop_outliers(views, 0.005, config, published=False)[0].points) > least
