"""Scatter of depths about their neighbours: it decides how ropes are sought."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.support.robust import DEVIATION_OF_MEDIAN
from strand.views.view import View

SMALL_SCATTER = 0.3  # radii: where depths scatter less, single points show tubes, and heights show ropes
_ROW_STEP = 7  # every seventh row of an image is used


def measure_depth_scatter(whole: Sequence[View], views: Sequence[View], wide: float) -> float:
    """Return the standard deviation of depths about their neighbours in the median view, metres.

    It is 0 if a view has no depth image.

    Parameters
    ----------
    whole : sequence of View
    views : sequence of View
        The same views, cropped.
    wide : float
        Metres. Cropped points that scatter less are ropes, and count alone: their surroundings may be rough.
    """
    images = [view.image for view in whole if view.image is not None]
    if len(images) < len(whole):
        return 0.0
    bends = _core.measure_depth_bends(
        [image.depth for image in images],
        [image.camera for image in images],
        [view.points for view in views],
        _ROW_STEP,
    )
    # a second difference has six times the variance of a depth
    found = DEVIATION_OF_MEDIAN * np.array(bends) / 6.0**0.5
    return _core.find_median([min(around, own) if 0.0 < own < wide else around for around, own in found])
