"""Tubes fitted together with the poses, and what the fit returns."""

from __future__ import annotations

import inspect
import pickle
from functools import partial

import numpy as np
import pytest

import strand
from shared.ropes import R
from strand._core import EndObservation, average_residuals, find_extents
from strand.geometry.curve import Curve


def test_a_fit_that_the_data_cannot_support_is_refused():
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1) + 5.0
    fit = partial(
        strand.fit_tubes,
        [np.random.default_rng(0).uniform(size=(50, 3))],
        np.zeros((1, 3)),
        [control],
        np.eye(4)[None],
        0.01,
        pose_sd=(0.01, 0.01),
    )
    with pytest.raises(strand.NotEnoughDataError, match="points"):
        fit(reference=None)
    with pytest.raises(ValueError, match="reference"):
        fit(reference=3)


def test_a_radius_that_would_fill_the_memory_is_refused():
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    with pytest.raises(ValueError, match="radius"):
        strand.fit_tubes(
            [np.zeros((5, 3))],
            np.ones((1, 3)),
            [control],
            np.eye(4)[None],
            1e-300,
            pose_sd=(0.1, 0.1),
            reference=None,
        )


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"reference": -1}, ValueError, "reference"),
        ({"iterations": -1}, ValueError, "iterations"),
        ({"pose_sd": (1.0,)}, ValueError, "pose_sd"),
        ({"band": (1.0,)}, ValueError, "band"),
        ({"radius_classes": [1]}, ValueError, "radius_classes"),
        ({"radius_classes": [0, 0]}, ValueError, "radius_classes"),
        ({"radius_classes": [0.0]}, TypeError, "radius_classes"),
        ({"radius_prior": (0.1, 0.0)}, ValueError, "radius_prior"),
        ({"radius_prior": [0.1]}, ValueError, "radius_prior"),
        ({"min_bend": 0.0}, ValueError, "min_bend"),
        ({"noise": -1.0}, ValueError, "noise"),
        ({"bounds": ([1.0] * 3, [0.0] * 3)}, ValueError, "bounds"),
    ],
)
def test_a_fit_refuses_wrong_input_by_name(change, error, message):
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    arguments = {"pose_sd": (0.1, 0.1), "reference": None} | change
    with pytest.raises(error, match=message):
        strand.fit_tubes([np.zeros((5, 3))], np.ones((1, 3)), [control], np.eye(4)[None], 0.1, **arguments)


def test_a_loop_that_the_points_show_is_not_stiffened_until_it_is_straight():
    """Noise makes it bend more tightly in places than ropes are said to."""
    r, turn = 0.0056, 2.6 * np.pi
    angle = np.interp(np.linspace(0.0, 1.0, 400), [0.0, 0.25, 0.75, 1.0], [0.0, 0.0, turn, turn])
    steps = np.stack([np.cos(angle), np.sin(angle), np.full(400, 0.03)], axis=1)
    nodes = np.cumsum(steps, axis=0) * 0.5 / 400
    nodes -= nodes.mean(axis=0) * [1.0, 1.0, 0.0] - [0.0, 0.0, r]
    scene = strand.synthetic.scene(
        chains=[nodes], radius=r, noise=strand.synthetic.Noise(depth=0.0013), views=3, seed=0
    )
    views = [view.crop(scene.bounds) for view in scene.views]
    start = strand._core.fit_spline(scene.truth[0][::3], 2.5 * r, 2.0 * r)
    fit = strand.fit_tubes(
        [view.world_points for view in views],
        [view.viewpoint for view in views],
        [start],
        [np.eye(4)] * 3,
        r,
        reference=1,
        pose_sd=(0.009, 0.0015),
        along_ray=True,
        iterations=60,
        min_bend=5.0,
    )
    assert Curve.whole(fit.curves[0]).length == pytest.approx(Curve.whole(start).length, rel=0.01)
    assert fit.inlier.mean() > 0.9


def straight_fit(**changes):
    """A fit to one view of a straight tube."""
    along, angle = np.meshgrid(np.linspace(0.0, 0.2, 120), np.linspace(0.1, np.pi - 0.1, 20))
    points = np.stack([along, 0.004 * np.cos(angle), 0.004 * np.sin(angle)], axis=-1).reshape(-1, 3)
    nodes = np.stack([np.linspace(0.0, 0.2, 50), np.zeros(50), np.zeros(50)], axis=1)
    arguments = {
        "points": [points],
        "viewpoints": [[0.1, 0.0, 1.0]],
        "curves": [strand._core.fit_spline(nodes, 0.01, 0.0)],
        "motions": [np.eye(4)],
        "radius": 0.004,
        "pose_sd": (0.01, 0.002),
        "reference": None,
    }
    return strand.fit_tubes(**arguments | changes)


def test_a_fit_can_be_pickled_and_changed():
    fit = straight_fit()
    again = pickle.loads(pickle.dumps(fit))
    names = inspect.signature(strand.TubeFit).parameters
    assert len(names) == 19
    for name in names:
        np.testing.assert_array_equal(getattr(again, name), getattr(fit, name))
    assert (fit.radius(0), fit.band(0)) == (fit.radii[0], fit.bands[0])
    np.testing.assert_array_equal(fit.pose_sd, np.sqrt(fit.pose_covariance.diagonal(axis1=1, axis2=2)))
    wider = fit.replace(radii=np.array([0.005]))
    assert (wider.radius(0), fit.radius(0)) == (0.005, 0.004)
    assert wider.points is fit.points
    assert len(repr(fit).splitlines()) == 1
    with pytest.raises(ValueError, match="curve: expected the number of one of"):
        fit.radius(1)


def test_a_fits_noise_is_a_number_of_double_precision():
    fit = straight_fit()
    with pytest.raises(ValueError, match="sigma: expected a number of double precision"):
        fit.replace(sigma=10**400)
    with pytest.raises(TypeError, match="sigma: expected a number"):
        fit.replace(sigma="1e-3")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"radius_classes": np.array([1])}, "radius_classes: expected the number of one of 1 radii"),
        ({"radii": np.zeros(0)}, "radius_classes"),
        ({"bands": np.zeros(2)}, "bands: expected one for each of 1 radii"),
        ({"view": np.zeros(3, dtype=np.int64)}, "view: expected one row for each of the 2400 points, got 3"),
        ({"points": np.zeros((2400, 2))}, r"points: expected shape \(2400, 3\), got \(2400, 2\)"),
        ({"curve": np.full(2400, 1)}, "curve: expected the number of one of 1 curves"),
        ({"pose_covariance": np.zeros((1, 3, 3))}, r"pose_covariance: expected shape \(V, 6, 6\)"),
    ],
)
def test_a_fit_whose_arrays_do_not_belong_together_is_refused(change, message):
    with pytest.raises(ValueError, match=f"^{message}"):
        straight_fit().replace(**change)


def test_defaults_of_a_fit_are_what_its_signature_says():
    parameters = inspect.signature(strand.fit_tubes).parameters.values()
    said = {one.name: one.default for one in parameters if one.default is not one.empty}
    assert said["iterations"] == 12
    bent = {"min_bend": 30.0, "along_ray": True}
    for change in ({}, bent):
        fit, same = straight_fit(**change), straight_fit(**said | change)
        for name in ("curves", "bands", "residual", "pose_covariance", "covariances"):
            np.testing.assert_array_equal(getattr(fit, name), getattr(same, name))


def test_numbers_of_a_fit_may_be_whole():
    box = {"bounds": ([-1, -1, -1], [1, 1, 1])}
    whole = straight_fit(viewpoints=[[0, 0, 1]], motions=[np.eye(4, dtype=int)], min_bend=2, **box)
    box = {"bounds": ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0])}
    same = straight_fit(viewpoints=[[0.0, 0.0, 1.0]], min_bend=2.0, **box)
    np.testing.assert_array_equal(whole.curves[0], same.curves[0])


def test_an_end_observation_can_be_pickled():
    seen = EndObservation(1, 2, [0, 0, 1], np.array([0.0, 1.0, 0.0]), 1e-3)
    again = pickle.loads(pickle.dumps(seen))
    assert (again.view, again.end, again.sd) == (1, 2, 1e-3)
    assert again.place.tolist() == [0.0, 0.0, 1.0]
    assert again.outward.tolist() == [0.0, 1.0, 0.0]
    assert repr(again) == repr(seen)


def test_extents_need_a_tolerance_for_each_curve():
    fit = straight_fit()
    ((start, stop),) = find_extents(fit)
    assert 0.0 <= start < stop <= len(fit.curves[0]) - 3
    assert find_extents(fit, [1e-3]) == [pytest.approx((start, stop), abs=0.2)]
    with pytest.raises(ValueError, match="surface_tolerance: expected one for each of 1 curves, got 2"):
        find_extents(fit, [1e-3, 1e-3])


def fewer(fit, left_out):
    """A fit without its first points."""
    each = [
        "points",
        "to_camera",
        "view",
        "curve",
        "parameter",
        "residual",
        "facing",
        "weight",
        "explained",
        "inlier",
    ]
    return fit.replace(**{name: getattr(fit, name)[left_out:] for name in each})


def test_residuals_are_averaged_in_each_view_along_stretches_of_the_curves():
    control = np.stack([np.arange(6.0), np.zeros(6), np.zeros(6)], axis=1)
    rng = np.random.default_rng(5)
    x, angle = rng.uniform(1.0, 4.0, 600), rng.uniform(0.0, np.pi, 600)
    points = np.stack([x, np.cos(angle), np.sin(angle)], axis=1) + rng.normal(scale=0.01, size=(600, 3))
    fit = strand.fit_tubes(
        [points[:400], points[400:]],
        [[2.0, 0.0, 50.0]] * 2,
        [control, control + np.array([0.0, 9.0, 0.0])],
        [np.eye(4)] * 2,
        1.0,
        pose_sd=(0.01, 0.01),
        reference=0,
    )
    own = np.flatnonzero(fit.inlier)
    length, stretches = 0.7, int(6 / 0.7) + 1
    group = (fit.view[own] * 2 + fit.curve[own]) * stretches + (fit.parameter[own] / length).astype(np.int64)
    count, mean, square = average_residuals(fit, length)
    expected = np.bincount(group, minlength=4 * stretches)
    assert np.count_nonzero(expected) > 6
    assert np.array_equal(count, expected)
    for found, values in ((mean, fit.residual[own]), (square, fit.residual[own] ** 2)):
        sums = np.bincount(group, values, minlength=4 * stretches)
        assert np.array_equal(found, sums / np.maximum(expected, 1))
    for bad in (0.0, -1.0, np.nan, 1e-9):
        with pytest.raises(ValueError, match="length: expected spans"):
            average_residuals(fit, bad)


def test_a_fit_goes_on_from_an_earlier_one():
    scene = strand.synthetic.scene("s", seed=3)
    views = [view.crop(scene.bounds) for view in scene.views]
    start = strand._core.fit_spline(scene.truth[0], 1.5 * R, 2.0 * R)
    fit = partial(
        strand.fit_tubes,
        [view.world_points for view in views],
        [view.viewpoint for view in views],
        radius=R,
        reference=3,
        pose_sd=(0.009, 0.0015),
        along_ray=True,
        iterations=30,
    )
    first = fit([start], [np.eye(4)] * len(views), uncertainty=False)
    again = fit(first.curves, first.motions, previous=first)
    anew = fit(first.curves, first.motions)
    # what another search for the points' places changes is far below the curve's standard deviation
    sd = np.sqrt(np.trace(again.covariances[0][:, 0], axis1=1, axis2=2)).mean()
    assert np.abs(again.curves[0] - anew.curves[0])[3:-3].max() < sd
    assert (again.inlier == anew.inlier).mean() > 0.999
    # no more steps than allowed, however far it is from its end
    once = fit(first.curves, first.motions, previous=first, iterations=1, tolerance=1e-300)
    assert np.abs(once.curves[0] - again.curves[0])[3:-3].max() < sd
    lost = ~np.isfinite(first.residual)
    assert not np.isfinite(again.residual[lost]).any()
    with pytest.raises(ValueError, match="previous"):
        fit([start], first.motions, previous=fewer(first, 1))
    with pytest.raises(ValueError, match="previous"):
        fit([start[:4]], first.motions, previous=first)
