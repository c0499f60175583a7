"""Depths of the 12-bit codes in LeRobot's depth videos.

The code c of 0 to 4095 stands for the depth at c / 4095 of the way from `depth_min` to `depth_max`: in metres
or, by default, in the logarithm of metres with `shift` added. Then a step is 1.3 mm at 0.5 m.

LeRobot 0.6.2 (commit 7427f31, `datasets/depth_utils.py`) clips depths to this range, so the first and the
last code mean no depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

LAST_CODE = 4095
_DEFAULTS = {"depth_min": 0.01, "depth_max": 10.0, "shift": 3.5}  # metres


@dataclass(frozen=True)
class DepthCodes:
    """What the codes of a video stand for.

    Attributes
    ----------
    depth_min, depth_max : float
        Depths of the first and the last code, metres.
    shift : float
        Metres that are added before the logarithm.
    use_log : bool
    lossless : bool
        Whether the encoder kept the codes as they were.
    """

    depth_min: float
    depth_max: float
    shift: float
    use_log: bool
    lossless: bool

    def list_depths(self) -> NDArray[np.float32]:
        """Return the (4096,) depths of all codes, metres; 0 is no depth."""
        share = np.arange(LAST_CODE + 1) / LAST_CODE
        if self.use_log:
            low, high = math.log(self.depth_min + self.shift), math.log(self.depth_max + self.shift)
            depths = np.exp(low + share * (high - low)) - self.shift
        else:
            depths = self.depth_min + share * (self.depth_max - self.depth_min)
        depths[[0, -1]] = 0.0
        return depths.astype(np.float32)

    def describe(self) -> str:
        """Return the range in words."""
        scale = "log" if self.use_log else "linear"
        return (
            f"{self.depth_min:g} to {self.depth_max:g} m, {scale}, {'lossless' if self.lossless else 'lossy'}"
        )


def read_codes(info: dict[str, Any]) -> DepthCodes:
    """Return the codes of a feature by its `info`, with LeRobot's defaults; ValueError if they are odd."""
    low, high, shift = (_read_metres(info, name) for name in ("depth_min", "depth_max", "shift"))
    use_log = info.get("video.use_log")
    use_log = True if use_log is None else use_log
    if not isinstance(use_log, bool):
        raise ValueError(f"video.use_log: expected true or false, got {use_log!r}"[:200])
    if not 0 <= low < high or (use_log and low + shift <= 0):
        raise ValueError(
            "expected 0 <= depth_min < depth_max, and a positive depth_min + shift, got "
            f"{low:g}, {high:g}, {shift:g}"
        )
    options = info.get("video.extra_options")
    return DepthCodes(low, high, shift, use_log, "lossless=1" in str(options))


def _read_metres(info: dict[str, Any], name: str) -> float:
    value = info.get(f"video.{name}")
    value = _DEFAULTS[name] if value is None else value
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= 1e6:
        raise ValueError(f"video.{name}: expected metres, got {value!r}"[:200])
    return float(value)
