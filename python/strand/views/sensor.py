"""A depth camera's errors: their size, their correlation between pixels, and presets."""

from __future__ import annotations

import dataclasses
import difflib
import math
from dataclasses import dataclass

from strand.support.checks import check_nonnegative, check_number, check_positive, describe_value


@dataclass(frozen=True)
class DepthError:
    """A sensor's errors at one depth.

    Attributes
    ----------
    sd : float
        Standard deviation along the viewing ray, metres.
    correlation : float
        As `Sensor.correlation`, pixels.
    step : float
        Smallest difference of depths that the sensor resolves, metres.
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

    The standard deviation along the viewing ray has two independent parts: `sd + slope z` at depth z, and
    `disparity z^2 / (f b)` of a stereo pair with the focal length f in pixels and the baseline b.

    Parameters
    ----------
    sd : float
        Standard deviation along the ray at zero depth, metres.
    slope : float
        Its growth per metre of depth, metres.
    disparity : float
        Standard deviation of the disparity, pixels of the depth image; needs `baseline`.
    baseline : float
        Distance between a stereo pair's cameras, metres; 0 for other sensors.
    correlation : float
        Range of the correlation between pixels: independent errors smoothed with a Gaussian of this standard
        deviation, pixels. Errors d pixels apart then have a correlation of exp(-d^2 / (4 correlation^2)). For
        a matcher that averages over a window of w pixels it is about w / 3.5.
    step : float
        Smallest difference of depths that the sensor resolves, metres.
    disparity_step : float
        The same for the disparity of a stereo pair, pixels; needs `baseline`.
    bias : float
        Distance by which a rope's middle appears too far away, metres; negative for too near. A matcher mixes
        the depth of the background into that of a thin rope. Only readings of images use it.
    lateral : float
        Standard deviation of the position of a mask's edge, pixels; strand measures it if it is 0. Only
        readings of images use it.

    Raises
    ------
    TypeError
        If a value is not a number.
    ValueError
        If a value is not finite, one other than the bias is negative, none of `sd`, `slope` and `disparity`
        is above 0, or a disparity comes without a baseline.

    Examples
    --------
    >>> import strand
    >>> sensor = strand.Sensor(disparity=0.08, baseline=0.05)
    >>> round(sensor.at(depth=0.5, focal=600.0).sd, 6)
    0.000667
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
            raise ValueError("Sensor: expected sd, slope or disparity above 0")
        for name in ("disparity", "disparity_step"):
            if getattr(self, name) and not self.baseline:
                raise ValueError(f"Sensor.{name}: expected a baseline above 0 with it")

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
        # metres of depth per pixel of disparity
        stretch = z * z / (f * self.baseline) if self.baseline else 0.0
        return DepthError(
            sd=math.hypot(self.sd + self.slope * z, self.disparity * stretch),
            correlation=self.correlation,
            step=math.hypot(self.step, self.disparity_step * stretch),
            bias=self.bias,
            lateral=self.lateral,
        )


# docs/sensors.md has the source of each number
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
"""The sensors of common cameras, by name."""


def find_preset(name: str) -> Sensor:
    """Return the sensor of a camera by its name.

    Capitals, spaces, hyphens, underscores, "RealSense" and makers' names make no difference.

    Parameters
    ----------
    name : str
        One of `PRESETS`, such as "d435" or "RealSense D435".

    Raises
    ------
    TypeError
        If the name is not text.
    ValueError
        If there is no such camera.
    """
    if not isinstance(name, str):
        raise TypeError(f"Config.sensor: expected a Sensor or a camera's name, got {describe_value(name)}")
    wanted = _shorten_name(name)
    for known, sensor in PRESETS.items():
        if _shorten_name(known) == wanted:
            return sensor
    near = difflib.get_close_matches(wanted, map(_shorten_name, PRESETS), 1)
    hint = "" if not near else f" (did you mean {next(k for k in PRESETS if _shorten_name(k) == near[0])!r}?)"
    raise ValueError(f"Config.sensor: no camera is called {name!r}{hint}; known are {', '.join(PRESETS)}")


def _shorten_name(name: str) -> str:
    short = "".join(letter for letter in name.lower() if letter.isalnum())
    for word in ("intel", "realsense", "stereolabs", "microsoft", "orbbec"):
        short = short.removeprefix(word)
    return short
