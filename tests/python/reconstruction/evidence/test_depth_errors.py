"""Errors of depth images."""

from __future__ import annotations

import numpy as np
import pytest

from strand.reconstruction.evidence.depth_errors import correlate_on_planes, find_depth_step


def test_steps_of_depths_are_seen_where_there_are_some():
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.3, 0.5, 3000)
    assert find_depth_step(np.rint(depth / 1e-3) * 1e-3) == pytest.approx(1e-3)
    assert find_depth_step(depth) == 0.0


@pytest.mark.parametrize("missing", [0.0, 0.01])
def test_errors_on_a_plane_correlate_as_they_were_made_whatever_single_pixels_lack_depth(missing):
    rng = np.random.default_rng(1)
    alone = rng.normal(size=(241, 320))
    # neighbours in a column share half of their variance
    depth = 0.6 + 2e-4 * np.arange(320) + 1e-3 * (alone[1:] + alone[:-1]) / 2.0**0.5
    depth[rng.random(depth.shape) < missing] = 0.0
    (found,), followed = correlate_on_planes([(depth, 0.6)], 1)
    # none in a row
    assert found + followed == pytest.approx(0.25, abs=0.03)


def test_surroundings_without_planes_give_no_correlation():
    assert correlate_on_planes([(np.zeros((240, 320)), 0.6)], 1) == ([], 0.0)
    rough = np.random.default_rng(2).standard_t(1.0, (240, 320))
    assert correlate_on_planes([(0.6 + 0.01 * np.abs(rough), 0.6)], 1) == ([], 0.0)
