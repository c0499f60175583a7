"""Readings and their fits."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import strand
from strand._core import RopeImages
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.images import comparison, method
from strand.reconstruction.images.comparison import (
    Explanation,
    Reading,
    _has_lost,
    find_likely_readings,
    fit_readings,
    leaves_nothing_open,
)
from strand.reconstruction.images.pixel_errors import Errors
from strand.reconstruction.radius import Radii
from strand.reconstruction.stages import Run
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
    nodes = [np.linspace((0.0, 0.0, 0.5), (0.5, 0.0, 0.5), 250)]
    fit = SimpleNamespace(areas=np.array(areas), misfit=misfit, nodes=nodes)
    return Explanation(Reading(0.0, 0, []), fit, cost)


def _know(ropes=None, length=None):
    prior = Prior(ropes=ropes, lengths=() if length is None else (length,))
    return SimpleNamespace(prior=prior, radii=Radii.from_caller(4e-3))


def test_nothing_is_open_if_every_view_is_explained_and_no_other_reading_is_near():
    assert leaves_nothing_open([_explain(5.0)], _know())
    assert leaves_nothing_open([_explain(5.0), _explain(9.5)], _know(ropes=1, length=0.5))


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
    assert not leaves_nothing_open(found, _know())


@pytest.mark.parametrize("known", [_know(ropes=2), _know(length=0.7)])
def test_something_is_open_if_the_caller_knows_better(known):
    assert not leaves_nothing_open([_explain(5.0)], known)


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


def test_other_views_are_not_read_after_the_deadline(monkeypatch):
    made = scene("granny", views=5, seed=0, camera=Camera("d405", size=(320, 240)), mask=Segmentation())
    read, late = [], []

    def read_and_list(images, ropes, views, **others):
        read.append(list(views))
        return find_likely_readings(images, ropes, views, **others)

    def fit_until_the_deadline(*arguments):
        late.append(True)
        return fit_and_rank(*arguments)

    def skip_if_late(run, work):
        if late and work not in run.skipped:
            run.skipped.append(work)
        return bool(late)

    fit_and_rank = method.fit_and_rank
    monkeypatch.setattr(comparison, "_CLEAR_OUTSIDE", 0.0)
    monkeypatch.setattr(method, "find_likely_readings", read_and_list)
    monkeypatch.setattr(method, "fit_and_rank", fit_until_the_deadline)
    monkeypatch.setattr(Run, "skips", skip_if_late)
    model = strand.reconstruct(made.views, made.radius, made.bounds, ropes=1)
    assert len(read) == 1
    assert any("readings of all views but one" in str(doubt) for doubt in model.doubts)


def test_areas_are_those_of_the_views_and_their_mean_is_the_misfit():
    made = scene("overhand", views=3, seed=2, camera=Camera("zed", size=(320, 240)), mask=Segmentation())
    images = [view.image for view in made.views]
    both = [
        RopeImages(
            [image.depth for image in some],
            [image.mask for image in some],
            [image.camera for image in some],
            [image.pose for image in some],
            made.radius,
        )
        for some in (images, images[::2])
    ]
    # the last rope's half leaves mask uncovered
    (reading, *_) = find_likely_readings(both[0], 1, [0])
    half = [nodes[: len(nodes) // 2] for nodes in reading.chains]
    fitted = [
        seen.fit([(0, half)], None, 0, (0.01, 0.002), Errors().values, 3, False, among)[0]
        for seen, among in ((both[0], None), (both[0], [0, 2]), (both[1], None))
    ]
    for fit, views in zip(fitted, (3, 2, 2), strict=True):
        np.testing.assert_allclose(fit.areas.sum(axis=0) / views, fit.misfit[:3])
    assert (fitted[0].areas[:, 0] > 1.0).all()
    assert np.array_equal(fitted[1].areas[::2], fitted[2].areas)
    assert not fitted[1].areas[1].any()
