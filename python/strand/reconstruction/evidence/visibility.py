"""Find out from the cameras' rays whether a place is occupied, occluded or free."""

from __future__ import annotations

from collections.abc import Sequence

from strand._core import Visibility
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View

__all__ = ["Visibility", "sort_rays"]


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

    Those to occluders end right before the camera, so that nothing behind these is free.
    """
    measured = view.measured
    if not isinstance(measured, DepthImage):
        return measured
    return (measured.blocked_depth, *measured.camera)
