"""Thin ropes that are too low for the given radius are reported; ropes and bare tables have no low strips."""

from __future__ import annotations

import pytest

import strand
from strand.synthetic import Noise, random_ropes, scene

R = 4e-3


@pytest.mark.parametrize("views", [1, 3])
def test_a_dropped_thin_rope_is_doubted(views):
    ropes = random_ropes(0, 2, R, 18)
    made = scene(chains=ropes, radius=(R, 0.4 * R), seed=18, noise=Noise(depth=0.1 * R), views=views)
    model = strand.reconstruct(made.views, R)
    assert len(model.chains) == 1
    (doubt,) = (doubt for doubt in model.doubts if doubt.kind == "left out")
    assert "too low for a rope" in doubt.reason
    assert doubt.place is not None
    assert any(warning.kind == "left out" for warning in model.warnings)
    assert model.confidence < 0.7


def test_ropes_of_the_radius_leave_no_low_strips():
    made = scene(chains=random_ropes(0, 2, R, 18), radius=R, seed=18, noise=Noise(depth=0.1 * R), views=3)
    assert strand.find_ropes(made.views, R).low_strips == ()
    assert strand.find_ropes(strand.synthetic.cluttered_scene(4).views).low_strips == ()
