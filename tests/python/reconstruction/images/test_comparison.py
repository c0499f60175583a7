"""Readings and their fits."""

from __future__ import annotations

from types import SimpleNamespace

import strand
from strand.reconstruction.images.comparison import Explanation, Reading, fit_readings
from strand.reconstruction.images.pixel_errors import Errors


def test_known_fits_are_kept_in_the_order_of_the_readings():
    first, known, last = (Reading(cost, 0, []) for cost in (1.0, 2.0, 3.0))
    asked = []

    def fit(hypotheses, *_):
        asked.extend(hypotheses)
        return ["first", None]

    images = SimpleNamespace(radii=[1.0], fit=fit)
    explanations = [Explanation(known, "known", 0.0)]
    pairs = fit_readings(images, [first, known, last], None, 0, Errors(), strand.Config(), explanations)
    assert len(asked) == 2
    assert pairs == [(first, "first"), (known, "known")]
