"""A given radius that the masks contradict is doubted and named, and ropes in wider masks do not break."""

from __future__ import annotations

import numpy as np
import pytest

import strand


def _reconstruct(kind, seed, share):
    made = strand.synthetic.frame_scene(kind, seed)
    view = strand.View.from_depth(
        made.depth[0], made.intrinsics, made.poses[0], depth_scale=made.depth_scale, mask=made.mask[0]
    )
    return made, strand.reconstruct([view], radius=share * made.radius)


def _find_radius_doubts(model):
    return [doubt for doubt in model.doubts if doubt.kind == "radius" and "masks are" in doubt.reason]


@pytest.mark.parametrize("seed", [400, 407])
def test_a_diameter_given_as_radius_is_doubted(seed):
    made, model = _reconstruct("usual", seed, 2.0)
    (doubt,) = _find_radius_doubts(model)
    assert "narrower" in doubt.reason
    assert "diameter" in doubt.reason
    assert f"{2e3 * made.radius:.1f} mm" in doubt.reason
    assert any(warning.kind == "radius" and warning.amount == doubt.amount for warning in model.warnings)
    assert model.confidence < 0.85


@pytest.mark.parametrize("seed", [100, 104, 105])
@pytest.mark.parametrize("share", [0.5, 0.6])
def test_a_radius_well_below_that_of_the_mask_is_named_and_the_rope_is_whole(seed, share):
    made, model = _reconstruct("usual", seed, share)
    (doubt,) = _find_radius_doubts(model)
    assert "wider" in doubt.reason
    assert model.confidence < 0.85
    (chain,) = model.chains
    away = np.linalg.norm(chain.points[:, None] - made.truth[0], axis=2)
    assert max(away.min(axis=0).max(), away.min(axis=1).max()) < 1.5 * made.radius


@pytest.mark.parametrize(("kind", "seed"), [("usual", 400), ("fat", 404), ("thin", 404), ("ragged", 404)])
def test_a_right_radius_is_not_doubted(kind, seed):
    _, model = _reconstruct(kind, seed, 1.0)
    assert _find_radius_doubts(model) == []
