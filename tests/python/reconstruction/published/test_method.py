"""The published method from views to strings."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import strand
from lib.measure import Crossings
from shared.ropes import find_warnings
from strand import config
from strand.config import Filter
from strand.reconstruction.outliers import drop_outliers

PUBLISHED = strand.Config.published()


@pytest.mark.parametrize(
    "name",
    ["straight_0.3mm", "straight_0.7mm", "arc_0.3mm", "arc_0.7mm", "s_0.3mm", "s_0.7mm", "figure8_low"],
)
def test_the_published_method_holds_on_plain_strings_and_steep_crossings(collected, measure, name):
    scene = collected(name)
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=PUBLISHED)
    found = measure(model, scene.truth, scene.radius)
    assert found.right
    assert found.rms < 1e-3
    assert found.length_error < 0.01
    assert found.crossings.found == found.crossings.true == found.crossings.right


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_papers_string_is_cut_in_seven_and_made_whole(measure, seed):
    scene = strand.synthetic.scene("paper", seed=seed)
    model = strand.reconstruct(
        scene.views, scene.radius, scene.bounds, ropes=1, config=PUBLISHED, keep_stages=True
    )
    assert len(model.stages["segments"]) == 7
    assert len(model.chains) == 1
    found = measure(model, scene.truth, scene.radius)
    assert found.right
    assert found.rms < 1e-3
    assert found.length_error < 0.02
    assert found.crossings == Crossings(found=3, true=3, right=3)


def test_the_published_method_has_no_confidence(paper, tmp_path):
    model = strand.reconstruct(paper.views, paper.radius, paper.bounds, config=strand.Config.published())
    assert np.isnan(model.confidence)
    assert model.joins == ()
    model.save(tmp_path / "model.json")
    assert np.isnan(strand.load_model(tmp_path / "model.json").confidence)


def test_the_published_method_takes_one_radius(collected):
    scene = collected("s_0.7mm")
    with pytest.raises(ValueError, match="radius"):
        strand.reconstruct(scene.views, [0.004, 0.006], scene.bounds, config=strand.Config.published())


def test_numbers_of_the_configuration_are_used():
    scene = strand.synthetic.scene("arc", seed=3)
    coarse = dataclasses.replace(
        strand.Config.published(),
        tracing=config.Tracing(near=2.0, far=4.0),
        normals=config.Normals(radius=1.3),
    )
    fine = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=strand.Config.published())
    rough = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=coarse)
    assert len(rough.chains[0].points) < 0.7 * len(fine.chains[0].points)


@pytest.fixture(scope="module")
def coarse():
    """A rope whose points have few neighbours."""
    return strand.synthetic.scene("arc", views=3, camera=strand.synthetic.Camera(size=(160, 120)), seed=2)


def reconstruct_bits(scene, config):
    model = strand.reconstruct(scene.views, scene.radius, scene.bounds, config=config, keep_stages=True)
    return [chain.points.tobytes() for chain in model.chains], [
        points.tobytes() for points in model.stages["filtered"]
    ]


def test_both_ways_to_ask_for_the_published_method_give_the_same_bits(coarse):
    assert reconstruct_bits(coarse, strand.Config(method="published")) == reconstruct_bits(coarse, PUBLISHED)
    assert reconstruct_bits(coarse, PUBLISHED) != reconstruct_bits(coarse, strand.Config())


def test_the_published_method_never_widens_its_filter(coarse):
    chains, filtered = reconstruct_bits(coarse, PUBLISHED)
    for widen_below in (1e-3, 1e6):
        other = dataclasses.replace(PUBLISHED, filter=Filter(widen_below=widen_below))
        assert reconstruct_bits(coarse, other) == (chains, filtered)
    cropped = [view.crop(coarse.bounds) for view in coarse.views]
    kept = [
        [view.world_points.tobytes() for view in drop_outliers(cropped, coarse.radius, Filter(), published)]
        for published in (True, False)
    ]
    assert filtered == kept[0]
    # the default method widens its filter in these views
    assert kept[1] != kept[0]
    assert reconstruct_bits(coarse, strand.Config())[1] == kept[1]


def test_a_view_that_cannot_be_registered_is_named(coarse):
    # three points on a line: a surface for the filter that is asked for nothing, but none for ICP
    line = np.array([[0.0, 0.0, 0.012], [1e-4, 0.0, 0.012], [2e-4, 0.0, 0.012]])
    lost = strand.View.from_world(line, [0.0, 0.0, 0.4])
    config = dataclasses.replace(PUBLISHED, filter=Filter(min_neighbors=0))
    views = [lost, *coarse.views]
    model = strand.reconstruct(views, coarse.radius, coarse.bounds, config=config)
    assert [warning.view for warning in find_warnings(model, "kept pose")] == [0]
    np.testing.assert_array_equal(model.poses[0], lost.pose)
