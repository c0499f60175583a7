"""Imitated depth cameras: size, correlation and edge bias of their errors."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from strand.synthetic import CAMERAS, DepthCamera, camera_pose, render_depth
from strand.synthetic.shapes import shape

RADIUS = 0.0042
SCALE = 2e-5
# pixels: radius of the ropes to which the cameras' parameters were fitted
PIXELS = {"d435": 4.1, "d405": 6.3, "zed": 3.3, "sgbm": 3.3, "tof": 4.3}
FOCUS = {"d435": 425.0, "d405": 430.0, "zed": 530.0, "sgbm": 530.0, "tof": 505.0}
# radii: measured on those ropes, 1.4826 times the median absolute error, and the bias of the rope's middle
# towards the table
NOISE = {"d435": 0.41, "d405": 0.59, "zed": 0.65, "sgbm": 0.98, "tof": 0.35}
PUSHED = {"d435": 0.25, "d405": 0.41, "zed": 0.52, "sgbm": 0.71, "tof": 0.0}
STEREO = [name for name, camera in CAMERAS.items() if camera.baseline is not None]


def pinhole(focus, size):
    return np.array([[focus, 0.0, 0.5 * (size[0] - 1)], [0.0, focus, 0.5 * (size[1] - 1)], [0.0, 0.0, 1.0]])


def exact(chains, camera, size=(240, 180), elevation=70.0, table=3.0):
    """Return a depth image from the distance to which the camera's parameters were fitted."""
    K = pinhole(FOCUS[camera], size)
    pose = camera_pose(0.0, FOCUS[camera] * RADIUS / PIXELS[camera], math.radians(elevation))
    return render_depth(chains, RADIUS, K, pose, size, table), K, pose


def sensed(camera, depth, K, seed=0):
    return camera.sense(depth, K, depth_scale=SCALE, rng=np.random.default_rng(seed)) * SCALE


def robust(errors):
    return 1.4826 * np.median(np.abs(errors - np.median(errors)))


def disparity_error(camera, name, seed=0):
    depth, K, _ = exact([], name)
    seen = sensed(camera, depth, K, seed)
    to_disparity = FOCUS[name] * camera.baseline
    return np.where(seen > 0, to_disparity / np.where(seen > 0, seen, 1.0) - to_disparity / depth, 0.0)


@pytest.mark.parametrize("name", STEREO)
def test_stereo_errors_have_the_given_size_in_disparity(name):
    plain = dataclasses.replace(CAMERAS[name], amplitude=0.0, step=0.0, uneven=0.0, missing=0.0)
    errors = np.stack([disparity_error(plain, name, seed) for seed in range(4)])
    assert errors.std() == pytest.approx(plain.sd, rel=0.06)
    assert abs(errors.mean()) < 0.1 * plain.sd
    # uneven errors are larger, but rarer
    uneven = dataclasses.replace(plain, uneven=0.5)
    larger = np.stack([disparity_error(uneven, name, seed) for seed in range(4)])
    assert robust(larger) == pytest.approx(plain.sd, rel=0.15)
    assert (np.abs(larger) > 3 * plain.sd).mean() > 4 * (np.abs(errors) > 3 * plain.sd).mean() > 0


def test_time_of_flight_errors_have_the_given_size_in_depth():
    camera = dataclasses.replace(CAMERAS["tof"], amplitude=0.0)
    depth, K, _ = exact([], "tof")
    errors = sensed(camera, depth, K) - depth
    assert errors.std() == pytest.approx(camera.sd, rel=0.06)
    wavy = dataclasses.replace(camera, sd=0.0, amplitude=0.001)
    assert np.abs(sensed(wavy, depth, K) - depth).max() == pytest.approx(0.001, rel=0.1)


@pytest.mark.parametrize("name", CAMERAS)
def test_noise_is_set_at_a_distance(name):
    depth, K, _ = exact([], name)
    distance = float(np.median(depth))
    still = dataclasses.replace(CAMERAS[name], amplitude=0.0, step=0.0, uneven=0.0, missing=0.0)
    for noise in (0.3 * RADIUS, 1.0 * RADIUS):
        camera = still.with_noise(noise, FOCUS[name], distance)
        near = np.abs(depth - distance) < 0.03 * distance
        errors = np.concatenate([(sensed(camera, depth, K, seed) - depth)[near] for seed in range(4)])
        assert errors.std() == pytest.approx(noise, rel=0.12)


@pytest.mark.parametrize("name", CAMERAS)
def test_errors_have_the_correlation_length_in_rows_and_columns(name):
    camera = dataclasses.replace(CAMERAS[name], amplitude=0.0, step=0.0, uneven=0.0, missing=0.0)
    depth, K, _ = exact([], name)
    errors = np.stack([sensed(camera, depth, K, seed) - depth for seed in range(6)]) / depth**2
    variance = (errors**2).mean()
    length = camera.correlation_length
    assert 1.0 <= length <= 6.0
    for axis in (1, 2):
        lags = np.arange(1, 9)
        size = errors.shape[axis]
        found = [
            (np.take(errors, range(lag, size), axis) * np.take(errors, range(size - lag), axis)).mean()
            / variance
            for lag in lags
        ]
        assert np.interp(length, lags, found) == pytest.approx(1.0 / math.e, abs=0.07)
    alone = DepthCamera("mine", None, sd=0.001, grain=((0.0, 1.0),))
    assert alone.correlation_length == 0.0


def profile(name, camera, seeds=4):
    """Return the mean error in radii by distance from the axis in radii, and all errors on the rope."""
    nodes = shape("straight", RADIUS, 0.5)
    nodes = np.stack([nodes[:, 1], nodes[:, 0], nodes[:, 2]], axis=1)  # along the image's rows
    depth, K, pose = exact([nodes], name)
    seen = nodes - pose[:3, 3]
    line = (seen @ pose[:3, :3])[len(nodes) // 2]
    row = K[1, 1] * line[1] / line[2] + K[1, 2]
    away = np.abs(np.arange(depth.shape[0]) - row) / (K[1, 1] * RADIUS / line[2])
    columns = slice(20, -20)
    errors = np.stack(
        [
            np.where(image > 0, (image - depth) / RADIUS, np.nan)[:, columns]
            for image in (sensed(camera, depth, K, seed) for seed in range(seeds))
        ]
    )

    def mean(low, high):
        return float(np.nanmean(errors[:, (away >= low) & (away < high)]))

    on_rope = errors[:, away < 0.95]
    return mean, on_rope[np.isfinite(on_rope)]


@pytest.mark.parametrize("name", CAMERAS)
def test_errors_on_a_rope_match_the_fitted_ones(name):
    mean, on_rope = profile(name, CAMERAS[name])
    assert 1.4826 * np.median(np.abs(on_rope)) == pytest.approx(NOISE[name], rel=0.35)
    assert mean(0.0, 0.5) == pytest.approx(PUSHED[name], abs=0.2)
    assert abs(mean(5.0, 7.0)) < 0.15


@pytest.mark.parametrize("name", STEREO)
def test_stereo_mixes_edges_in_both_directions(name):
    camera = dataclasses.replace(CAMERAS[name], sd=0.0, amplitude=0.0)
    mean, _ = profile(name, camera, seeds=2)
    assert mean(0.0, 0.5) > 0.15  # towards the table
    assert mean(1.05, 1.5) < -0.35  # the table towards the rope
    assert abs(mean(5.0, 7.0)) < 0.02
    still, _ = profile(name, dataclasses.replace(camera, window=0.0, lateral=0.0, step=0.0), seeds=1)
    assert abs(still(0.0, 0.9)) < 1e-2


def test_time_of_flight_mixes_edges_with_the_background():
    mean, _ = profile("tof", dataclasses.replace(CAMERAS["tof"], sd=0.0, amplitude=0.0), seeds=1)
    assert mean(0.75, 1.0) > 0.25
    assert abs(mean(0.0, 0.5)) < 0.1
    assert abs(mean(1.2, 2.0)) < 0.1


@pytest.mark.parametrize("name", STEREO)
def test_steps_at_crossings_are_smoothed(name):
    half = 0.06
    low = np.array([[0.0, -half, RADIUS], [0.0, 0.0, RADIUS], [0.0, half, RADIUS]])
    high = np.array([[-half, 0.0, 3.1 * RADIUS], [0.0, 0.0, 3.1 * RADIUS], [half, 0.0, 3.1 * RADIUS]])
    depth, K, pose = exact([low, high], name, elevation=90.0)
    camera = dataclasses.replace(
        CAMERAS[name], sd=0.0, amplitude=0.0, step=0.0, missing=0.0, missing_edge=0.0
    )
    error = (sensed(camera, depth, K) - depth) / RADIUS

    def at(nodes):
        seen = (nodes - pose[:3, 3]) @ pose[:3, :3] @ K.T
        return np.mean([error[round(v / z), round(u / z)] for u, v, z in seen])

    assert at(np.array([[0.0, 0.0, 4.1 * RADIUS]])) > 0.05  # the upper strand, farther than it is
    beside = np.array([[0.0, 1.6 * RADIUS, 2 * RADIUS], [0.0, -1.6 * RADIUS, 2 * RADIUS]])
    alone = np.array([[0.0, 8 * RADIUS, 2 * RADIUS], [0.0, -8 * RADIUS, 2 * RADIUS]])
    assert at(beside) < at(alone) - 0.15  # the lower one beside it, nearer than elsewhere


def test_a_far_wall_is_not_mixed_with_the_rope():
    K = pinhole(425.0, (160, 120))
    rope = np.array([[-0.2, 0.0, 0.5], [0.2, 0.0, 0.5]])
    depth = render_depth([rope], RADIUS, K, np.eye(4), (160, 120), False)
    wall = np.where(depth > 0, depth, 1.3)
    seen = sensed(CAMERAS["d435"], wall, K)
    between = (seen > 0.56) & (seen < 1.1)
    assert between.sum() < 0.02 * (depth > 0).sum()
    # the lateral error displaces the edge
    moved = (np.abs(seen - 0.5) < 0.06) != (depth > 0)
    assert 0.02 * (depth > 0).sum() < moved.sum() < 0.5 * (depth > 0).sum()
    # pixels without a return stay without one
    assert not sensed(CAMERAS["d435"], depth, K)[depth == 0].any()


def test_disparities_are_drawn_to_steps_and_rounded():
    camera = dataclasses.replace(CAMERAS["sgbm"], sd=0.1)
    depth, K, _ = exact([], "sgbm", elevation=50.0)
    to_disparity = FOCUS["sgbm"] * camera.baseline
    steps = to_disparity / sensed(camera, depth, K) / camera.step
    assert np.abs(steps - np.rint(steps)).max() < 0.05
    phase = steps * camera.step
    assert np.cos(2 * np.pi * phase).mean() > 0.15  # more often near whole disparities
    free = dataclasses.replace(camera, amplitude=0.0)
    assert abs(np.cos(2 * np.pi * to_disparity / sensed(free, depth, K)).mean()) < 0.05


def test_the_given_fraction_of_pixels_has_no_depth():
    depth, K, _ = exact([shape("arc", RADIUS, 0.2)], "d435")
    table, _, _ = exact([], "d435")
    rope = depth < table - 1e-9
    for missing, patch in ((0.0, 1.5), (1.0 / 3.0, 2.5), (0.02, 1.0), (1.0, 1.5)):
        camera = dataclasses.replace(CAMERAS["d435"], missing=missing, missing_edge=missing, patch=patch)
        holes = np.stack([sensed(camera, depth, K, seed) == 0 for seed in range(5)])
        assert holes.mean() == pytest.approx(missing, rel=0.15)
        assert holes[:, rope].mean() == pytest.approx(missing, rel=0.35)
    at_edges = dataclasses.replace(CAMERAS["d435"], missing=0.0, missing_edge=0.5)
    holes = sensed(at_edges, depth, K) == 0
    rows, columns = np.nonzero(holes)
    assert len(rows) > 100
    around = np.pad(rope, 3)
    assert all(around[v : v + 7, u : u + 7].any() for v, u in zip(rows, columns, strict=True))


@pytest.mark.parametrize("name", CAMERAS)
def test_same_generator_same_bits(name):
    depth, K, _ = exact([shape("loop", RADIUS, 0.3)], name)
    first, again, other = (sensed(CAMERAS[name], depth, K, seed) for seed in (3, 3, 4))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    camera = dataclasses.replace(CAMERAS[name], missing=0.1)
    louder = dataclasses.replace(camera, sd=2 * camera.sd)
    assert np.array_equal(sensed(camera, depth, K) == 0, sensed(louder, depth, K) == 0)


def test_depths_beyond_uint16_are_dropped():
    K = pinhole(425.0, (40, 30))
    far = CAMERAS["d435"].sense(np.full((30, 40), 9.0), K, depth_scale=1e-4, rng=np.random.default_rng(0))
    assert far.dtype == np.uint16
    assert not far.any()
    nothing = CAMERAS["tof"].sense(np.zeros((30, 40)), K, depth_scale=1e-4, rng=np.random.default_rng(0))
    assert not nothing.any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (dict(baseline=0.0), "baseline: expected a positive"),
        (dict(sd=-1.0), "sd: expected a number >= 0"),
        (dict(sd=math.nan), "sd: expected a number >= 0"),
        (dict(limit=0.0), "limit: expected a positive"),
        (dict(period=0.0), "period: expected a positive"),
        (dict(window=65.0), "window: expected at most 64 pixels, got 65"),
        (dict(patch=-1.0), "patch: expected a number >= 0"),
        (dict(missing=1.5), "missing: expected a fraction from 0 to 1, got 1.5"),
        (dict(grain=()), "grain: expected at least one field"),
        (dict(grain=((1.0, 0.0),)), "grain: expected at least one field"),
        (dict(grain=((100.0, 1.0),)), r"grain\[0\]\[0\]: expected at most 64 pixels"),
        (dict(grain=((1.0,),)), r"grain\[0\]: expected a smoothness and a share"),
    ],
)
def test_wrong_numbers_of_a_camera(arguments, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(CAMERAS["d435"], **arguments)
    with pytest.raises(TypeError, match="sd: expected a number, got str"):
        DepthCamera("mine", None, sd="low")


def test_wrong_images():
    camera, K, rng = CAMERAS["d435"], pinhole(425.0, (4, 3)), np.random.default_rng(0)
    depth = np.full((3, 4), 0.5)
    with pytest.raises(ValueError, match="depth: expected shape"):
        camera.sense(depth[0], K, depth_scale=1e-4, rng=rng)
    with pytest.raises(ValueError, match=r"depth: expected depths >= 0, got -0\.5"):
        camera.sense(-depth, K, depth_scale=1e-4, rng=rng)
    with pytest.raises(ValueError, match="depth: expected finite"):
        camera.sense(depth * np.nan, K, depth_scale=1e-4, rng=rng)
    with pytest.raises(ValueError, match="depth_scale: expected a positive"):
        camera.sense(depth, K, depth_scale=0.0, rng=rng)
    with pytest.raises(TypeError, match=r"rng: expected type Generator, got int"):
        camera.sense(depth, K, depth_scale=1e-4, rng=0)
    with pytest.raises(ValueError, match="distance: expected a positive"):
        camera.with_noise(0.001, 425.0, 0.0)
