"""Summarize a view in numbers: points, distances, missing pixels, mask and colours."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class ViewSummary:
    """The content of one view.

    Attributes
    ----------
    kind : str
        "depth image" or "points".
    size : (int, int) or None
        Width and height of the image, pixels; None for points.
    points : int
        Number of points, or of pixels with a depth.
    no_return : int or None
        Pixels of depth 0, or points at (0, 0, 0); None if the reader dropped these without counting.
    not_finite : int
        Pixels or points that are NaN or infinite.
    distance : (float, float) or None
        Smallest and largest, metres: depths along z of an image, or distances of points from the origin of
        their frame. None without points.
    corners : (2, 3) ndarray or None
        Low and high corner of the points in their own frame, metres; None for images.
    intrinsics : (float, float, float, float) or None
        Focal lengths fx, fy and principal point cx, cy of an image, pixels; None if not known, and for
        points.
    colors : bool
        Whether the view has colours.
    labels : int or None
        Number of labels in the mask, without 0; None without a mask.
    points_in_mask : int or None
        Pixels with a depth inside the mask; None without a mask.
    stamp : float or None
        When the view was taken, seconds; None if not known.
    """

    kind: str
    size: tuple[int, int] | None
    points: int
    no_return: int | None
    not_finite: int
    distance: tuple[float, float] | None
    corners: Array | None
    intrinsics: tuple[float, float, float, float] | None
    colors: bool
    labels: int | None = None
    points_in_mask: int | None = None
    stamp: float | None = None


def summarize_view(view: View, no_return: int | None = None) -> ViewSummary:
    """Summarize a view; `no_return` counts the points without a return that the reader dropped."""
    image = view.image
    if image is None:
        points = view.points
        far = np.linalg.norm(points, axis=1)
        return ViewSummary(
            "points",
            None,
            len(points),
            no_return,
            view.dropped,
            (float(far.min()), float(far.max())) if len(points) else None,
            np.array([points.min(axis=0), points.max(axis=0)]) if len(points) else None,
            None,
            view.colors is not None,
            stamp=view.stamp,
        )
    depth, labels = image.depth, image.labels
    returned = depth > 0.0
    points_seen = int(np.count_nonzero(returned))
    near = float(np.min(depth, where=returned, initial=np.inf))
    height, width = depth.shape
    return ViewSummary(
        "depth image",
        (width, height),
        points_seen,
        depth.size - points_seen - view.dropped,
        view.dropped,
        (near, float(depth.max())) if points_seen else None,
        None,
        (*image.camera.focal, *image.camera.center),
        view.colors is not None,
        None if labels is None else len(np.setdiff1d(labels, [0])),
        None if labels is None else int(np.count_nonzero(returned & image.mask)),
        view.stamp,
    )
