"""Intrinsics whose principal point is the middle of an image of another size."""

from __future__ import annotations

from collections.abc import Sequence

from strand.ropes.doubt import Doubt
from strand.views.depth_image import DepthImage
from strand.views.view import View

# how far the principal point is from the middle of an image, as a share of it: of the other image at most, of
# its own at least
_SAME, _OTHER = 0.04, 0.15
# how much doubt that is: a corner that was cut from an image looks alike
_SUSPECTED = 1.2


def off_centre(views: Sequence[View]) -> Doubt | None:
    """Doubt intrinsics of all views that are those of a transposed image, or of one of another size.

    Parameters
    ----------
    views : sequence of View

    Returns
    -------
    Doubt or None
    """
    images = {
        (view.image.camera.center, view.image.depth.shape): view.image
        for view in views
        if view.image is not None and view.image.depth.size
    }
    if len(images) != 1:
        return None
    reason = _why_off_centre(*images.values())
    return None if reason is None else Doubt("intrinsics", _SUSPECTED, "where the ropes are", reason)


def _why_off_centre(image: DepthImage) -> str | None:
    height, width = image.depth.shape
    cx, cy = image.camera.center
    across, down = (2.0 * cx + 1.0) / width, (2.0 * cy + 1.0) / height
    if min(across, down) <= 0.0 or max(abs(across - 1.0), abs(down - 1.0)) < _OTHER:
        return None
    where = (
        f"the principal point ({cx:.0f}, {cy:.0f}) is the middle of an image of "
        f"{across * width:.0f} x {down * height:.0f} pixels, depth has {width} x {height}"
    )
    shape = width / height
    if abs(across * shape - 1.0) < _SAME and abs(down / shape - 1.0) < _SAME:
        return f"depth looks transposed, rows for columns: {where}"
    if abs(across / down - 1.0) < _SAME:
        return f"intrinsics look like those of an image {across:.2g} times as large: {where}"
    return None
