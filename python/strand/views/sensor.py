"""A depth camera's errors: how large they are, how far they reach from pixel to pixel, and presets."""

from __future__ import annotations

import dataclasses
import difflib
import math
from dataclasses import dataclass

from strand.support.checks import check_nonnegative, check_number, check_positive


@dataclass(frozen=True)
class DepthError:
    """What a sensor's errors are at one depth.

    Attributes
    ----------
    sd : float
        Standard deviation along the viewing ray, metres.
    correlation : float
        As `Sensor.correlation`, pixels.
    step : float
        Distance between depths that the sensor can tell apart, metres.
    bias : float
        As `Sensor.bias`, metres.
    lateral : float
        As `Sensor.lateral`, pixels.
    """

    sd: float
    correlation: float
    step: float
    bias: float
    lateral: float


@dataclass(frozen=True)
class Sensor:
    """The errors of a depth camera's images.

    The standard deviation along the viewing ray is that of independent parts: `sd`, which grows with the
    depth z by `slope`, and `disparity` of a stereo pair, which makes z^2 / (f b) of it (f the focal length in
    pixels, b the baseline).

    Parameters
    ----------
    sd : float
        Standard deviation along the ray at no distance, metres.
    slope : float
        How much it grows for each metre of depth, metres.
    disparity : float
        Standard deviation of the disparity, pixels of the depth image; needs `baseline`.
    baseline : float
        Distance of a stereo pair's cameras, metres; 0 for other sensors.
    correlation : float
        How far errors reach from pixel to pixel: as if independent errors had been smoothed with a Gaussian
        of this standard deviation, pixels. Errors d pixels apart then have a correlation of
        exp(-d^2 / (4 correlation^2)). A window of w pixels over which a matcher averages is about w / 3.5.
    step : float
        Distance between depths that the sensor can tell apart, metres.
    disparity_step : float
        The same for a stereo pair's disparity, pixels; needs `baseline`.
    bias : float
        How much too far away a rope's middle is seen, metres: a matcher mixes the depth of what is behind a
        thin rope into all of its width. Below 0 for too near. Used for ropes that are read from images.
    lateral : float
        Standard deviation of the place of a mask's edge, pixels; measured if it is 0. Used where
        `bias` is: for ropes that are read from images.

    Raises
    ------
    TypeError
        If a value is not a number.
    ValueError
        If a value is not finite, one but the bias is negative, none of `sd`, `slope` and `disparity` is above
        0, or a disparity comes without a baseline.
    """

    sd: float = 0.0
    slope: float = 0.0
    disparity: float = 0.0
    baseline: float = 0.0
    correlation: float = 0.0
    step: float = 0.0
    disparity_step: float = 0.0
    bias: float = 0.0
    lateral: float = 0.0

    def __post_init__(self) -> None:
        for entry in dataclasses.fields(self):
            check = check_number if entry.name == "bias" else check_nonnegative
            value = check(f"Sensor.{entry.name}", getattr(self, entry.name))
            object.__setattr__(self, entry.name, value)
        if not (self.sd or self.slope or self.disparity):
            raise ValueError(
                "Sensor: expected sd, slope or disparity above 0: a sensor without errors is none"
            )
        for name in ("disparity", "disparity_step"):
            if getattr(self, name) and not self.baseline:
                raise ValueError(f"Sensor.{name}: expected a baseline above 0 along with it")

    def at(self, depth: float, focal: float) -> DepthError:
        """Return the errors at a depth.

        Parameters
        ----------
        depth : float
            Along the camera's z axis, metres.
        focal : float
            Focal length, pixels.

        Returns
        -------
        DepthError

        Raises
        ------
        TypeError
            If an argument is not a number.
        ValueError
            If one is not finite and above 0.
        """
        z, f = check_positive("depth", depth), check_positive("focal", focal)
        # metres of depth for a pixel of disparity
        stretch = z * z / (f * self.baseline) if self.baseline else 0.0
        return DepthError(
            sd=math.hypot(self.sd + self.slope * z, self.disparity * stretch),
            correlation=self.correlation,
            step=math.hypot(self.step, self.disparity_step * stretch),
            bias=self.bias,
            lateral=self.lateral,
        )


# docs/sensors.md has the source of each number, and says which are derived
_D400 = Sensor(disparity=0.08, baseline=0.05, disparity_step=1.0 / 32.0, correlation=2.0)
_PASSIVE = Sensor(disparity=0.25, baseline=0.12, correlation=2.0)
_TIME_OF_FLIGHT = Sensor(slope=0.0044, step=0.001, correlation=0.5)

PRESETS = {
    "d405": dataclasses.replace(_D400, baseline=0.018),
    "d415": dataclasses.replace(_D400, baseline=0.055),
    "d435": _D400,
    "d435i": _D400,
    "d455": dataclasses.replace(_D400, baseline=0.095),
    "l515": Sensor(sd=0.0025, correlation=0.5),
    "zed": _PASSIVE,
    "zed 2": _PASSIVE,
    "zed mini": dataclasses.replace(_PASSIVE, baseline=0.063),
    "gemini 305": Sensor(disparity=0.24, baseline=0.018, correlation=2.0),
    "azure kinect": _TIME_OF_FLIGHT,
    "femto bolt": _TIME_OF_FLIGHT,
}
"""Cameras that people own, by name."""


def preset(name: str) -> Sensor:
    """Return the sensor of a camera by its name.

    Capitals, spaces, hyphens and underscores do not count, nor do "RealSense" and the makers' names.

    Parameters
    ----------
    name : str
        One of `PRESETS`, such as "d435" or "RealSense D435".

    Raises
    ------
    TypeError
        If it is not text.
    ValueError
        If there is no such camera.
    """
    if not isinstance(name, str):
        raise TypeError(f"Config.sensor: expected a Sensor or a camera's name, got {name!r}")
    wanted = _short(name)
    for known, sensor in PRESETS.items():
        if _short(known) == wanted:
            return sensor
    near = difflib.get_close_matches(wanted, map(_short, PRESETS), 1)
    hint = "" if not near else f" (did you mean {next(k for k in PRESETS if _short(k) == near[0])!r}?)"
    raise ValueError(f"Config.sensor: no camera is called {name!r}{hint}; known are {', '.join(PRESETS)}")


def _short(name: str) -> str:
    short = "".join(letter for letter in name.lower() if letter.isalnum())
    for word in ("intel", "realsense", "stereolabs", "microsoft", "orbbec"):
        short = short.removeprefix(word)
    return short
