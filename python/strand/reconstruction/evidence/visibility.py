"""Find out from the cameras' rays whether a place is occupied, occluded or free."""

from __future__ import annotations

import math
from collections.abc import Sequence

from strand._core import Visibility
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.pinhole import Pinhole
from strand.views.view import View

__all__ = ["Visibility", "sort_rays"]

_MAX_PIXELS = 4096 * 4096  # of an image whose rays are all sorted


def sort_rays(views: Sequence[View], poses: Sequence[Array], about: Sequence[View]) -> Visibility:
    """Sort the views' rays by direction, for questions about places.

    Parameters
    ----------
    views : sequence of View
        Uncropped: a ray that ends on the table shows that the space before the table is free.
    poses : sequence of (4, 4) ndarray
        Their camera-to-world poses.
    about : sequence of View
        The parts of the views that questions are about: rays far from them are dropped.
    """
    return Visibility([_collect_rays(view) for view in views], [view.points for view in about], poses)


def _collect_rays(view: View) -> Array | tuple[Array, tuple[float, float], tuple[float, float]]:
    """Return where a view's rays end: its points, or its depth image with its pinhole.

    Those to occluders end right before the camera, so that nothing behind these is free. A huge image has
    rays through some of its rows and columns.
    """
    measured = view.measured
    if not isinstance(measured, DepthImage):
        return measured
    depth, camera = measured.blocked_depth, measured.camera
    side = math.ceil(math.sqrt(depth.size / _MAX_PIXELS))
    if side > 1:
        depth = depth[::side, ::side]
        camera = Pinhole(
            (camera.focal[0] / side, camera.focal[1] / side),
            (camera.center[0] / side, camera.center[1] / side),
        )
    return (depth, *camera)
