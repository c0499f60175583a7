"""Readings and their fits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import strand
from strand.reconstruction.images import comparison, method
from strand.reconstruction.images.comparison import (
    Explanation,
    Reading,
    _has_lost,
    explain_all_views,
    find_likely_readings,
    fit_readings,
)
from strand.reconstruction.images.pixel_errors import Errors
from strand.synthetic import Camera, Segmentation, scene


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


def test_a_course_that_lost_is_not_fitted_again_for_other_views(monkeypatch):
    made = scene("overhand", views=3, seed=2, camera=Camera("zed", size=(320, 240)), mask=Segmentation())
    fitted = []

    def fit_and_count(images, readings, table, held, errors, config, known):
        fitted[-1] += len(readings) - len(known)
        return fit_readings(images, readings, table, held, errors, config, known)

    monkeypatch.setattr(comparison, "fit_readings", fit_and_count)
    monkeypatch.setattr(comparison, "_CLEAR_OUTSIDE", 0.0)
    nodes = []
    for lost in (comparison._LOST, np.inf):
        monkeypatch.setattr(comparison, "_LOST", lost)
        fitted.append(0)
        nodes.append(strand.reconstruct(made.views, made.radius, made.bounds, ropes=1).chains[0].points)
    assert fitted[0] < fitted[1]
    assert np.array_equal(*nodes)


def test_a_course_does_not_lose_by_labels_and_bends_that_only_its_own_view_shows():
    image = strand.View.from_depth(np.full((48, 64), 0.5), np.diag([60.0, 60.0, 1.0]), np.eye(4)).image
    nodes = np.linspace((0.1, 0.1, 0.5), (0.4, 0.3, 0.5), 40)
    fit = SimpleNamespace(nodes=[nodes], corrections=np.zeros((2, 6)))
    best = Explanation(Reading(0.0, 0, []), SimpleNamespace(nodes=[nodes[::-1][:20]]), 30.0)
    other = Reading(2.0, 1, [image.project(nodes)])
    for reading_cost, lost in ((1.0, True), (8.0, False)):
        found = [best, Explanation(Reading(2.0, 0, []), fit, 40.0, reading_cost)]
        assert _has_lost(other, found, SimpleNamespace(radii=[2.0, 2.0]), [image, image]) == lost
    elsewhere = Reading(2.0, 1, [image.project(nodes) + 5.0])
    assert not _has_lost(elsewhere, found, SimpleNamespace(radii=[2.0, 2.0]), [image, image])


def _explain(cost, areas=((0.05, 0.5, 0.6), (0.0, 0.4, 0.7)), change=0.2):
    misfit = [0.1, 0.4, 0.6, 1.0, 2.0, 3.0, change]
    return Explanation(Reading(0.0, 0, []), SimpleNamespace(areas=np.array(areas), misfit=misfit), cost)


def test_nothing_is_open_if_every_view_is_explained_and_no_other_reading_is_near():
    assert explain_all_views([_explain(5.0)])
    assert explain_all_views([_explain(5.0), _explain(9.5)])


@pytest.mark.parametrize(
    "found",
    [
        pytest.param([], id="no explanation"),
        pytest.param([_explain(5.0), _explain(8.5)], id="a near rival"),
        pytest.param([_explain(5.0, areas=((0.0, 0.4, 0.7), (0.5, 0.0, 0.0)))], id="uncovered in one view"),
        pytest.param([_explain(5.0, areas=((0.0, 0.4, 0.7), (0.0, 0.9, 0.7)))], id="outside in one view"),
        pytest.param([_explain(5.0, change=0.8)], id="strands may be exchanged"),
    ],
)
def test_something_is_open(found):
    assert not explain_all_views(found)


def test_other_views_are_read_only_if_the_first_one_leaves_something_open(monkeypatch):
    made = scene("overhand", views=3, seed=2, camera=Camera("zed", size=(320, 240)), mask=Segmentation())
    read = []

    def read_and_list(images, ropes, views, **others):
        read[-1].append(views)
        return find_likely_readings(images, ropes, views, **others)

    monkeypatch.setattr(method, "find_likely_readings", read_and_list)
    nodes = []
    for most in (comparison._CLEAR_OUTSIDE, 0.0):
        monkeypatch.setattr(comparison, "_CLEAR_OUTSIDE", most)
        read.append([])
        nodes.append(strand.reconstruct(made.views, made.radius, made.bounds, ropes=1).chains[0].points)
    (first,), (again, others) = read
    assert first == again
    assert sorted(first + others) == [0, 1, 2]
    away = np.linalg.norm(nodes[0][:, None] - nodes[1], axis=2).min(axis=1)
    assert away.max() < made.radius
