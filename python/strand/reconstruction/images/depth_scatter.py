"""How far depths scatter about their neighbours', which tells how rope may be found in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.support.robust import DEVIATION_OF_MEDIAN
from strand.views.view import View

# every so many rows are asked
_EVERY = 7


def depth_scatter(whole: Sequence[View], views: Sequence[View], wide: float) -> float:
    """Return how far depths scatter about their neighbours' in the median view.

    Parameters
    ----------
    whole : sequence of View
    views : sequence of View
        The same views, cropped.
    wide : float
        Points of the cropped views that scatter less than this are ropes, metres: what is around them may be
        rough.

    Returns
    -------
    float
        Standard deviation, metres; 0 if not all are of depth images.
    """
    images = [view.image for view in whole if view.image is not None]
    if len(images) < len(whole):
        return 0.0
    bends = _core.depth_bends(
        [image.depth for image in images],
        [image.camera for image in images],
        [view.points for view in views],
        _EVERY,
    )
    # of normal noise: the median's size, and a second difference has six times the variance of a depth
    found = DEVIATION_OF_MEDIAN * np.array(bends) / 6.0**0.5
    return float(np.median([min(around, own) if 0.0 < own < wide else around for around, own in found]))
