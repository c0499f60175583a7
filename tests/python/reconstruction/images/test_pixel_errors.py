"""The sensor's errors where ropes are read from images: given, measured and used."""

from __future__ import annotations

import numpy as np
import pytest

import strand
from lib.calibration import Truth, compute_calibration
from strand.reconstruction.images.pixel_errors import Errors, _average_over_discs, convert_sensor
from strand.reconstruction.images.prepare import prepare_images
from strand.synthetic import Camera, Layout, Segmentation, scene
from strand.views.rope_images import make_rope_images

SIZE = (320, 240)


@pytest.fixture(scope="module")
def made():
    return scene("s", camera=Camera("zed", size=SIZE), mask=Segmentation(), views=1)


def reconstructed(made, sensor=None):
    return strand.reconstruct(made.views, made.radius, ropes=1, config=strand.Config(sensor=sensor))


def spread(model, axis):
    """Root mean square standard deviation of nodes along the rays or across them, metres."""
    (chain,) = model.chains
    inside = slice(8, -8)
    ray = model.poses[0][:3, 3] - chain.points
    ray /= np.linalg.norm(ray, axis=1)[:, None]
    across = np.cross(chain.tangents, ray)
    across /= np.linalg.norm(across, axis=1)[:, None]
    way = across if axis == "across" else np.cross(across, chain.tangents)
    return float(np.sqrt(np.einsum("ni,nij,nj->n", way, chain.covariance, way)[inside].mean()))


@pytest.mark.parametrize("correlation", [0.0, 0.7, 3.0])
def test_errors_of_discs_correlate_as_all_pairs_of_their_pixels(correlation):
    pixels = 7.0
    y, x = np.mgrid[-4:5, -4:5]
    x, y = x[np.hypot(x, y) <= 0.6 * pixels], y[np.hypot(x, y) <= 0.6 * pixels]

    def correlate(lag):
        square = (x[:, None] - x + lag) ** 2 + (y[:, None] - y) ** 2
        return np.mean(np.exp(-square / (4.0 * correlation**2)) if correlation else square == 0)

    share, length = _average_over_discs(correlation, pixels)
    assert share == pytest.approx(min(1.25 * correlate(0) ** 0.5, 1.0))
    assert length == pytest.approx(
        (1.0 + 2.0 * sum(correlate(lag) / correlate(0) for lag in range(1, 60))) / pixels
    )


def test_errors_of_the_widest_ropes_and_correlations_take_no_longer():
    # the discs' pixels make a thousand million pairs, and as many lags
    share, length = _average_over_discs(2.0, 300.0)
    assert 0.0 < share < 0.1
    assert 1.0 < length < 1.2
    share, length = _average_over_discs(1e9, 8.0)
    assert share == 1.0
    assert length > 8.0


@pytest.mark.parametrize("correlation", [0.0, 1.0, 2.5])
def test_errors_of_discs_are_those_of_smoothed_noise(made, correlation):
    (image,) = make_rope_images(made.views, made.views, None)
    images = prepare_images([image], made.radius)
    pixels = float(images.radii[0])
    sd = 0.2 * made.radius
    found = convert_sensor(strand.Sensor(sd=sd, correlation=correlation), [image], images, made.radius, 1)
    # noise of unit standard deviation, smoothed by its spectrum
    rng = np.random.default_rng(5)
    side = 360
    noise = rng.normal(size=(side, side))
    if correlation:
        ways = np.fft.fftfreq(side)
        smooth = np.exp(-2.0 * (np.pi * correlation) ** 2 * (ways[:, None] ** 2 + ways**2))
        noise = np.fft.ifft2(np.fft.fft2(noise) * smooth).real
        noise /= noise.std()
    y, x = np.mgrid[-9:10, -9:10]
    disc = np.argwhere(np.hypot(x, y) <= max(0.6 * pixels, 1.0)) - 9
    shifted = [np.roll(noise, way, axis=(0, 1)) for way in disc]
    medians = np.median(shifted, axis=0)
    assert found.noise == pytest.approx(0.2 * medians.std(), rel=0.2)
    correlations = [(medians * np.roll(medians, lag, axis=1)).mean() / medians.var() for lag in range(1, 25)]
    length = (1.0 + 2.0 * sum(a for a in correlations if a > 0.02)) / pixels
    assert found.correlation == pytest.approx(max(length, 1.0), rel=0.3)
    assert found.lateral == Errors().lateral


def test_the_measured_sensor_is_reported(made):
    sensor = reconstructed(made).sensor
    assert 0.05 * made.radius < sensor.sd < made.radius
    assert 0.1 <= sensor.lateral < 1.0
    # matchers mix the table into the rope
    assert 0.0 < sensor.bias < made.radius


def test_wider_noise_widens_covariances_along_the_rays(made):
    known = strand.Sensor(sd=0.1 * made.radius, correlation=1.0, lateral=0.3)
    wide = strand.Sensor(sd=1.0 * made.radius, correlation=1.0, lateral=0.3)
    one, other = reconstructed(made, known), reconstructed(made, wide)
    assert spread(other, "along") > 1.3 * spread(one, "along")
    assert spread(other, "across") == pytest.approx(spread(one, "across"), rel=0.1)
    # the measured sensor is reported all the same
    assert other.sensor.sd < 0.6 * made.radius


def test_wider_errors_of_edges_widen_covariances_across_the_rays(made):
    one = reconstructed(made, strand.Sensor(sd=0.3 * made.radius, correlation=1.0, lateral=0.2))
    other = reconstructed(made, strand.Sensor(sd=0.3 * made.radius, correlation=1.0, lateral=0.9))
    assert spread(other, "across") > 1.5 * spread(one, "across")


def test_a_known_bias_is_subtracted():
    nearer, biases = [], []
    for seed in range(4):
        hung = scene(
            "s",
            seed=seed,
            camera=Camera("zed", size=SIZE),
            mask=Segmentation(),
            views=1,
            layout=Layout(wall=0.3),
        )
        sd = 0.3 * hung.radius
        models = [
            reconstructed(hung, strand.Sensor(sd=sd, correlation=1.0, bias=bias))
            for bias in (0.0, hung.radius)
        ]
        camera = hung.poses[0][:3, 3]
        away = [np.linalg.norm(model.chains[0].points - camera, axis=1).mean() for model in models]
        nearer.append((away[0] - away[1]) / hung.radius)
        biases.append((models[1].sensor.bias - models[0].sensor.bias) / hung.radius)
    # one scene's ropes follow its noise by up to a third of the bias
    assert np.mean(nearer) == pytest.approx(1.0, rel=0.15)
    assert np.mean(biases) == pytest.approx(1.0, rel=0.15)


def test_errors_of_nodes_are_as_large_as_covariances_say():
    found = []
    for seed, (name, camera) in enumerate(
        (("s", "tof"), ("arc", "d435"), ("loop", "zed"), ("figure8", "sgbm"))
    ):
        made = scene(name, seed=seed, camera=Camera(camera, size=SIZE), mask=Segmentation(), views=1)
        found.append(compute_calibration(reconstructed(made).chains, Truth.of(made.truth, made.radius))[1])
    assert 0.7 < np.sqrt(np.mean(found)) < 1.5
