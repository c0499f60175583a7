"""A depth camera's errors, and cameras by name."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest

import strand
from strand import Sensor, config
from strand.views.sensor import PRESETS, find_preset


def test_errors_of_stereo_grow_with_the_square_of_the_depth():
    sensor = Sensor(disparity=0.08, baseline=0.05, disparity_step=0.25, correlation=2.0)
    near, far = sensor.at(0.4, 400.0), sensor.at(0.8, 400.0)
    assert near.sd == pytest.approx(0.08 * 0.4**2 / (400.0 * 0.05))
    assert far.sd == pytest.approx(4.0 * near.sd)
    assert near.step == pytest.approx(0.25 * 0.4**2 / (400.0 * 0.05))
    assert (near.correlation, near.bias, near.lateral) == (2.0, 0.0, 0.0)


def test_errors_of_time_of_flight_grow_with_the_depth():
    sensor = Sensor(sd=0.001, slope=0.002, step=0.001)
    assert sensor.at(0.5, 500.0).sd == pytest.approx(0.002)
    assert sensor.at(1.0, 500.0).sd == pytest.approx(0.003)
    assert sensor.at(1.0, 500.0).step == pytest.approx(0.001)


def test_a_bias_may_be_towards_the_camera():
    assert Sensor(sd=0.001, bias=-0.002).at(0.5, 500.0).bias == -0.002


@pytest.mark.parametrize(
    ("wrong", "error", "message"),
    [
        ({}, ValueError, "Sensor: expected sd, slope or disparity above 0"),
        ({"sd": -1.0}, ValueError, r"Sensor\.sd"),
        ({"sd": float("nan")}, ValueError, r"Sensor\.sd"),
        ({"sd": "wide"}, TypeError, r"Sensor\.sd"),
        ({"sd": 0.001, "correlation": float("inf")}, ValueError, r"Sensor\.correlation"),
        ({"sd": 0.001, "bias": float("nan")}, ValueError, r"Sensor\.bias"),
        ({"disparity": 0.1}, ValueError, r"Sensor\.disparity: expected a baseline"),
        ({"sd": 0.001, "disparity_step": 0.1}, ValueError, r"Sensor\.disparity_step: expected a baseline"),
    ],
)
def test_wrong_sensors_are_refused(wrong, error, message):
    with pytest.raises(error, match=message):
        Sensor(**wrong)


def test_wrong_places_are_refused():
    with pytest.raises(ValueError, match="depth"):
        PRESETS["d435"].at(0.0, 400.0)
    with pytest.raises(ValueError, match="focal"):
        PRESETS["d435"].at(0.5, -1.0)


@pytest.mark.parametrize("name", ["d435", "D435", "RealSense D435", "intel_realsense-d435"])
def test_a_camera_goes_by_its_usual_names(name):
    assert find_preset(name) is PRESETS["d435"]
    assert strand.Config(sensor=name).sensor == PRESETS["d435"]


def test_a_camera_that_is_not_known_is_named_with_one_that_is():
    with pytest.raises(ValueError, match=r"Config\.sensor: no camera is called 'd436' \(did you mean 'd4"):
        strand.Config(sensor="d436")
    with pytest.raises(TypeError, match=r"Config\.sensor: expected a Sensor or a camera's name, got 3"):
        strand.Config(sensor=3)  # type: ignore[arg-type]


def test_noise_is_given_once():
    with pytest.raises(ValueError, match=r"Config\.sensor: .* without Tubes\.noise"):
        strand.Config(sensor="d435", tubes=config.Tubes(noise=0.001))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('sensor = "d455"\n', PRESETS["d455"]),
        ("[sensor]\nsd = 0.001\ncorrelation = 1.5\n", Sensor(sd=0.001, correlation=1.5)),
    ],
)
def test_a_file_gives_a_sensor(tmp_path, text, expected):
    path = tmp_path / "config.toml"
    path.write_text(text)
    assert config.load(path) == strand.Config(sensor=expected)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('sensor = "d999"\n', r"config.toml: Config\.sensor: no camera"),
        ("sensor = 3\n", r"config.toml: Config\.sensor: expected a Sensor or a camera's name"),
        ("[sensor]\nwidth = 1\n", r"\[sensor\] has no width; known are sd, slope"),
        ("[sensor]\nsd = -1.0\n", r"Sensor\.sd"),
        ("[sensor]\n", "expected sd, slope or disparity"),
    ],
)
def test_a_file_with_a_wrong_sensor_is_refused(tmp_path, text, message):
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(strand.FileFormatError, match=message):
        config.load(path)


def test_the_page_has_every_camera_with_its_numbers():
    page = (Path(__file__).resolve().parents[3] / "docs" / "sensors.md").read_text(encoding="utf-8")
    heading = re.search(r"^\| name \| (.+) \| sources \|$", page, re.MULTILINE)
    assert heading is not None
    fields = re.findall(r"`(\w+)`", heading[1])
    assert fields == [entry.name for entry in dataclasses.fields(Sensor)]
    said = {}
    for name, numbers in re.findall(r"^\| `([\w ]+)` \| (.+) \| [\d, ]+ \|$", page, re.MULTILINE):
        values = [float(number.strip(" *")) for number in numbers.split("|")]
        said[name] = Sensor(**dict(zip(fields, values, strict=True)))
    assert said == PRESETS
