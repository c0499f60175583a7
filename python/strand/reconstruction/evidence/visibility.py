"""What the cameras saw of a place: whether it is occupied, occluded or free."""

from __future__ import annotations

from collections.abc import Sequence

from strand._core import Visibility
from strand.support.checks import Array
from strand.views.depth_image import DepthImage
from strand.views.view import View

__all__ = ["Visibility", "visibility_from"]


def visibility_from(views: Sequence[View], poses: Sequence[Array], about: Sequence[View]) -> Visibility:
    """Grid the views' rays by direction, for questions about places.

    Parameters
    ----------
    views : sequence of View
        With all that they saw, beyond the ropes too: a ray that reached the table says that the space before
        the table is free.
    poses : sequence of (4, 4) ndarray
        Their camera-to-world poses.
    about : sequence of View
        What of each view will be asked for: directions far from all of it are left out.

    Returns
    -------
    Visibility
    """
    return Visibility([_rays(view) for view in views], [view.points for view in about], poses)


def _rays(view: View) -> Array | tuple[Array, tuple[float, float], tuple[float, float]]:
    """Return where a view's rays ended: its points, or its depth image with focal lengths and centre."""
    measured = view.measured
    return (measured.depth, *measured.camera) if isinstance(measured, DepthImage) else measured
