"""Doubts about errors that all pixels of a view share."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import strand
from strand._core import EndObservation
from strand.reconstruction import default
from strand.reconstruction.tubes.view_bias import find_bias_doubts


@pytest.fixture(scope="module")
def answered():
    """What was observed in a scene without errors, and the answer."""
    taken = []
    whole = default._find_in_used_views
    with pytest.MonkeyPatch.context() as patch:

        def kept(observed, config, run):
            taken.append((observed, whole(observed, config, run)))
            return taken[-1][1]

        patch.setattr(default, "_find_in_used_views", kept)
        scene = strand.synthetic.scene("arc", seed=0, views=5, noise=strand.synthetic.Noise(depth=0.3e-3))
        strand.reconstruct(scene.views, scene.radius, scene.bounds)
    (observed, found), *_ = taken
    return observed, found


def add_up(found):
    """Sums of the amounts by kind."""
    sums = {}
    for doubt in found:
        sums[doubt.kind] = sums.get(doubt.kind, 0.0) + doubt.amount
    return sums


def test_right_input_is_not_doubted(answered):
    observed, found = answered
    assert found.ends
    assert add_up(find_bias_doubts(observed, found)) == {"radius": 0.0, "residuals": 0.0}


def test_an_answer_without_tubes_is_not_doubted(answered):
    observed, found = answered
    assert find_bias_doubts(observed, replace(found, stages={})) == []


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_radius_that_the_points_contradict_is_doubted(factor):
    scene = strand.synthetic.scene("arc", seed=0, views=3, noise=strand.synthetic.Noise(depth=0.3e-3))
    model = strand.reconstruct(scene.views, factor * scene.radius, scene.bounds)
    (doubt,) = [doubt for doubt in model.doubts if doubt.kind == "radius"]
    assert doubt.amount > 0.3
    assert ("thicker" in doubt.reason) == (factor < 1.0)
    assert model.confidence < 0.9
    free = strand.reconstruct(scene.views, None, scene.bounds)
    assert not [doubt for doubt in free.doubts if doubt.kind == "radius"]


def test_residuals_that_are_correlated_along_the_rope_are_doubted(answered):
    observed, found = answered
    fit = found.stages["fit"]
    wave = 0.15 * fit.radii[0] * np.sin(fit.parameter / 2.0) * np.where(fit.view % 2, 1.0, -1.0)
    other = replace(found, stages={"fit": fit.replace(residual=fit.residual + wave)})
    assert add_up(find_bias_doubts(observed, other))["residuals"] > 0.3
    chance = 0.15 * fit.radii[0] * np.random.default_rng(0).normal(size=len(wave))
    other = replace(found, stages={"fit": fit.replace(residual=fit.residual + chance)})
    assert add_up(find_bias_doubts(observed, other))["residuals"] == 0.0


def test_an_end_that_views_see_in_different_places_is_doubted(answered):
    observed, found = answered
    end = found.ends[0].end
    own = [one for one in found.ends if one.end == end]
    assert len(own) > 2
    radius = found.stages["fit"].radius(end // 2)

    def doubt_end(by):
        ends = [
            EndObservation(
                one.view, one.end, one.place + by * (-1) ** k * radius * one.outward, one.outward, one.sd
            )
            for k, one in enumerate(own)
        ]
        return add_up(find_bias_doubts(observed, replace(found, ends=tuple(ends))))["residuals"]

    assert doubt_end(0.0) == 0.0
    assert doubt_end(1.0) > 0.3
