"""The outlier filter."""

from __future__ import annotations

import numpy as np

import strand
from shared.ropes import CAMERA, sample_strip
from strand.config import Filter
from strand.reconstruction.outliers import drop_outliers


def test_a_coarse_view_keeps_its_edges():
    points = sample_strip(0.004)[::40]
    stray = np.array([[0.0, 0.05, 0.0]])
    view = strand.View.from_world(np.vstack([points, stray]), CAMERA)
    kept = drop_outliers([view], 0.004, Filter(), widen=True)[0].world_points
    assert len(kept) > 0.9 * len(points)
    assert np.abs(kept[:, 1]).max() < 0.01
    assert len(drop_outliers([view], 0.004, Filter(widen_below=1.0), widen=True)[0].points) < 0.7 * len(
        points
    )
