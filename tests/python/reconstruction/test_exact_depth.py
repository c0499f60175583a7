"""Depth without noise, and a caller who makes NumPy raise: an answer, or an error of strand."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import strand

ROWS, COLUMNS = np.mgrid[:240, :320]
CAMERA = [[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]
ROPE = np.abs(ROWS - 120 - 30 * np.sin(COLUMNS / 40)) < 4
SCENES = {
    "a flat strip": np.where(ROPE, 0.99, 1.0),
    "one depth": np.ones(ROPE.shape),
    "the strip alone": np.where(ROPE, 0.99, 0.0),
    "a strip on a slope": 1.0 + 0.0005 * (ROWS - 120) - 0.008 * ROPE,
    "noise of a nanometre": np.where(ROPE, 0.99, 1.0) + np.random.default_rng(0).normal(0, 1e-9, ROPE.shape),
    "one pixel": np.ones((1, 1)),
    "a column": np.ones((50, 1)),
}


@pytest.mark.parametrize("radius", [None, 0.01])
@pytest.mark.parametrize("masked", [False, True])
@pytest.mark.parametrize("name", SCENES)
def test_exact_depth_is_answered_or_refused(name, masked, radius):
    depth = SCENES[name]
    mask = None
    if masked:
        mask = ROPE if depth.shape == ROPE.shape else np.ones(depth.shape, dtype=bool)
    view = strand.View.from_depth(depth, CAMERA, mask=mask)
    with np.errstate(all="raise"), warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            model = strand.reconstruct([view], radius=radius)
        except strand.StrandError:
            return
    assert np.isfinite(model.confidence)
