"""Stages, sensor and doubts of an answer that was read from images."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from strand.report import figures, tables
from strand.synthetic import Camera, Segmentation, scene


@pytest.fixture(scope="module")
def made():
    return scene("s", camera=Camera("zed"), mask=Segmentation(), views=1)


@pytest.fixture(scope="module")
def model(made):
    return strand.reconstruct(made.views, made.radius, ropes=1, keep_stages=True)


def test_its_stages_are_listed_and_drawn(made, model, tmp_path):
    assert tables.find_branch(model) == "images"
    table = tables.describe_stages(made.views, model)
    assert all(name in table for name in ("filter", "images", "readings", "explain"))
    assert "whole ropes" in tables.describe_counts(model)
    drawn = figures.write_figures(model, tmp_path)
    assert [path.name for path in drawn] == [
        "1-raw.png",
        "2-filtered.png",
        "3-registered.png",
        "4-ropes.png",
        "5-uncertainty.png",
        "6-cameras.png",
    ]
    assert all(path.stat().st_size > 1000 for path in drawn)


def test_it_measures_the_sensor(made, model):
    assert 0.0 < model.sensor.sd < made.radius
    assert 0.5 < model.sensor.correlation < 10.0


def test_a_long_stretch_without_depth_is_a_doubt_with_its_place(made, model):
    (view,) = made.views
    depth = view.image.depth.copy()
    bare = view.mask & (np.arange(depth.shape[1]) >= 160)
    depth[bare] = 0.0
    halved = strand.View.from_depth(depth, made.intrinsics, made.poses[0], mask=view.mask)
    unsure = strand.reconstruct([halved], made.radius, ropes=1)
    assert unsure.confidence < 0.9 < model.confidence
    (doubt,) = [doubt for doubt in unsure.doubts if doubt.kind == "points"]
    assert doubt.place is not None
    assert not [doubt for doubt in model.doubts if doubt.kind == "points"]
