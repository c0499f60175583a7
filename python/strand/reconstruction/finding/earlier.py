"""Where an image may show the ropes of an earlier frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from strand.ropes.chain import Chain
from strand.views.depth_image import DepthImage

_MARGIN = 12.0  # radii around ropes: they move less from frame to frame
_MIN_MARGIN = 0.06  # of the image's shorter side: the same
_MIN_SIDE = 60.0  # radii: a shorter side would limit the width of ropes that are sought
_MAX_SHARE = 0.7  # of the image's pixels: searching more saves nothing

Window = tuple[slice, slice]


def find_window(image: DepthImage, chains: Sequence[Chain]) -> Window | None:
    """Return the rows and columns of an image that may show chains; None without a smaller part."""
    if not chains:
        return None
    points = np.vstack([chain.points for chain in chains])
    away = (points - image.pose[:3, 3]) @ image.pose[:3, 2]
    if not (away > 0).all():
        return None
    radius = max(chain.radius for chain in chains) * image.camera.focal[0] / float(away.min())
    shape = image.depth.shape
    margin = max(_MARGIN * radius, _MIN_MARGIN * min(shape))
    spans = []
    for places, side in zip(image.project(points).T[::-1], shape, strict=True):
        low, high = float(places.min()) - margin, float(places.max()) + margin
        more = max(0.5 * (_MIN_SIDE * radius - (high - low)), 0.0)
        begin, end = max(int(low - more), 0), min(int(high + more) + 2, side)
        if begin >= end:
            return None
        spans.append(slice(begin, end))
    rows, columns = spans
    share = (rows.stop - rows.start) * (columns.stop - columns.start) / image.depth.size
    return (rows, columns) if share < _MAX_SHARE else None


def touches_side(mask: NDArray[np.bool_], window: Window) -> bool:
    """Tell whether an (H, W) mask in a window touches a side of it that is none of the image's."""
    own = mask[window]
    for (first, last), span, side in zip(
        ((own[0], own[-1]), (own[:, 0], own[:, -1])), window, mask.shape, strict=True
    ):
        if (span.start > 0 and first.any()) or (span.stop < side and last.any()):
            return True
    return False
