"""Arcs of several radii."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from shared.ropes import render_crossing
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Run
from strand.reconstruction.tubes import arcs
from strand.reconstruction.tubes.clouds import Clouds


def test_one_view_shows_which_of_two_kinds_a_rope_is(monkeypatch):
    fit, fitted = arcs.fit_curves, []

    def count(*arguments, **options):
        fitted.append(options.get("along_ray", False))
        return fit(*arguments, **options)

    monkeypatch.setattr(arcs, "fit_curves", count)
    views, bounds, _ = render_crossing(0.003, 0.006)
    clouds = Clouds.from_views([view.crop(bounds) for view in views[2:3]], None)
    # there is no rope of the last radius
    radii = Radii(np.array([0.003, 0.006, 0.015]), np.array([0.0002, 0.0003, 0.001]), free=False, held=True)
    few = clouds.thin_for_tracing(0.003)
    found, present = arcs.fit_arcs(clouds, few, np.eye(4)[None], radii, strand.Config(), Run(None))
    assert present.values.tolist() == found.radii.tolist() == [0.003, 0.006]
    # held radii need no fit along the rays
    assert fitted
    assert not any(fitted)
    model = strand.reconstruct(views[2:3], None, bounds)
    by_length = [chain.radius for chain in model.chains]
    assert by_length == pytest.approx([0.003, 0.006], rel=0.1)
