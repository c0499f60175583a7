"""How sure an answer is."""

from __future__ import annotations

import numpy as np
import pytest

import strand


def test_doubts_make_the_confidence(paper_model, tucked_under):
    scene = tucked_under
    for model in (paper_model, strand.reconstruct(scene.views, scene.radius, scene.bounds)):
        total = sum(doubt.amount for doubt in model.doubts)
        assert model.confidence == pytest.approx(np.exp(-0.01 - total), rel=1e-12)
        assert [doubt.amount for doubt in model.doubts] == sorted(
            (doubt.amount for doubt in model.doubts), reverse=True
        )
