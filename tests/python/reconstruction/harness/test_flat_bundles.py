"""Wires side by side under ties are wide and low."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.synthetic import Noise, harness


@pytest.mark.parametrize("seed", [3, 4])
def test_wires_that_lie_side_by_side_are_counted_by_their_width(seed):
    made = harness("tied", seed=seed, views=3, noise=Noise(depth=0.0003))
    wire = made.radii[0] / np.sqrt(made.wires[0])
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True, wire=wire)
    assert sorted(edge.wires for edge in model.harness.edges) == sorted(made.wires)
    assert any("side by side" in doubt.reason for doubt in model.doubts)


def test_round_bundles_raise_no_doubt_of_wires_side_by_side():
    made = harness("tree", seed=0, views=3, noise=Noise(depth=0.0003))
    model = strand.reconstruct(made.views, sorted(set(made.radii)), made.bounds, branches=True)
    assert not any("side by side" in doubt.reason for doubt in model.doubts)
