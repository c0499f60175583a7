"""The sensor's noise, measured on ropes."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from deviations import make_scene
from lib.calibration import Truth, compute_calibration
from strand.config import Tubes
from strand.reconstruction.tubes.noise import count_shared_points, find_correlation_length

SD = 0.7e-3  # metres


def normalize_errors(model, drawn):
    """Return the root mean square of the nodes' errors e over their deviations: e' C^-1 e / 2."""
    return np.sqrt(compute_calibration(model.chains, Truth.of(drawn.truth, drawn.radius))[1])


@pytest.mark.parametrize("views", [1, 3])
@pytest.mark.parametrize("correlation", [1.0, 1.5, 2.5])
def test_deviations_are_true_where_neighbours_share_errors(correlation, views):
    drawn = make_scene("s", 51, SD, correlation, views)
    model = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds)
    assert model.sensor.correlation == pytest.approx(correlation, rel=0.2)
    assert model.sensor.sd == pytest.approx(SD, rel=0.3)
    assert 0.6 < normalize_errors(model, drawn) < 1.7


@pytest.mark.parametrize("noise", [0.3e-3, 0.7e-3, 1.5e-3])
def test_independent_errors_are_found_to_be_independent(noise):
    drawn = make_scene("s", 51, noise, 0.0, 3)
    model = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds)
    assert model.sensor.correlation == 0.0
    assert model.sensor.sd == pytest.approx(noise, rel=0.1)
    assert model.sensor.step == pytest.approx(drawn.depth_scale, rel=1e-6)
    assert 0.6 < normalize_errors(model, drawn) < 1.5


def test_noise_is_measured_in_clouds_as_in_their_images():
    drawn = make_scene("s", 51, SD, 1.5, 3)
    points = [view.points for view in drawn.views]
    camera = [strand.View(cloud, view.pose) for cloud, view in zip(points, drawn.views, strict=True)]
    world = [strand.View.from_world(view.world_points, view.viewpoint) for view in drawn.views]
    for views in (camera, world):
        model = strand.reconstruct(views, drawn.radius, drawn.bounds)
        assert 0.7 < model.sensor.correlation < 2.2
        assert 0.6 < normalize_errors(model, drawn) < 1.7


def test_a_given_sensor_is_not_measured():
    drawn = make_scene("s", 51, SD, 0.0, 3)
    plain = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds)
    known = strand.Config(sensor=strand.Sensor(sd=SD, correlation=1.5))
    model = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds, config=known)
    ratio = normalize_errors(plain, drawn) / normalize_errors(model, drawn)
    assert 2.0 < ratio < 5.0
    assert model.sensor.correlation == 0.0
    as_measured = strand.Config(sensor=plain.sensor)
    again = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds, config=as_measured)
    assert normalize_errors(again, drawn) == pytest.approx(normalize_errors(plain, drawn), rel=0.05)


def test_given_noise_stays_where_neighbours_share_errors():
    drawn = make_scene("s", 51, SD, 1.5, 3)
    sizes = []
    for noise in (0.7e-3, 1.4e-3):
        config = strand.Config(tubes=Tubes(noise=noise))
        (chain,) = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds, config=config).chains
        # the two directions that the points fix; ends say how far nodes go along
        sizes.append(np.sqrt(np.median(np.linalg.eigvalsh(chain.covariance)[:, 0])))
    assert sizes[1] / sizes[0] == pytest.approx(2.0, rel=0.15)


def test_a_model_keeps_its_sensor_in_a_file(tmp_path):
    drawn = make_scene("s", 51, SD, 1.5, 1)
    model = strand.reconstruct(drawn.views, drawn.radius, drawn.bounds)
    model.save(tmp_path / "model.json")
    assert strand.load_model(tmp_path / "model.json").sensor == model.sensor
    assert isinstance(model.sensor, strand.Sensor)


def test_independent_points_each_count():
    assert count_shared_points(0.0, 5.0, 2.5) == (1.0, 1.0)
    along, across = count_shared_points(0.2, 5.0, 2.5)
    assert along == pytest.approx(1.0, abs=0.05)
    assert across == pytest.approx(1.0, abs=0.05)


def test_points_within_the_reach_of_errors_or_in_a_span_count_as_one():
    # the sum of all correlations about a pixel is 4 pi times the square of the length
    along, across = count_shared_points(2.0, 60.0, 2.5)
    assert along == pytest.approx(4.0 * np.pi * 4.0, rel=0.05)
    assert across < along
    span, width = 2.5 * 5.0, 2.0 * np.sqrt(1.0 - 0.4**2) * 5.0
    along, across = count_shared_points(50.0, 5.0, 2.5)
    assert along == pytest.approx(span * width, rel=0.1)
    # errors that both sides share move a rope along the rays only
    assert across == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("length", [0.5, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("followed", [0.0, 0.002])
def test_the_correlation_length_is_found(length, followed):
    lags = np.arange(1, 9)
    taken = followed * 4.0 * np.pi * length**2
    left = (np.exp(-((lags / (2.0 * length)) ** 2)) - taken) / (1.0 - taken)
    found, correlation = find_correlation_length(left.tolist(), followed)
    assert found == pytest.approx(length, rel=0.03)
    assert correlation == pytest.approx(np.exp(-1.0 / (4.0 * length**2)), abs=0.02)
