"""Tell which ropes depth can show: wide steps hide thin ones, and so do a matcher's windows."""

from __future__ import annotations

import numpy as np

import strand._core as _core
from strand.views.depth_image import DepthImage

_STEPS = 4  # depths on each side of the ropes' distance whose steps are looked at
_CLEAR_PIXELS = 2.0  # pixels: windows over which depth is taken do not hide ropes of a larger radius
_NO_PIXELS = 1.0  # pixels: they hide ropes of a smaller radius


def find_depth_step(image: DepthImage) -> float:
    """Return the distance between neighbouring depths of a sensor at the ropes' distance, metres.

    A stereo camera's disparity has steps, which are wider in depth the farther away.
    """
    near = _core.find_values_near(image.depth, image.distance, _STEPS)
    return _core.find_median(np.diff(near[near > 0])) if np.count_nonzero(near > 0) > 1 else 0.0


def show_in_windows(pixels: float) -> float:
    """Return how clearly depth shows a rope of a radius, pixels: from 0, not at all, to 1 and beyond.

    Matchers take depth over windows. A rope that is narrower than half of one leaves no trace.
    """
    return (pixels - _NO_PIXELS) / (_CLEAR_PIXELS - _NO_PIXELS)
