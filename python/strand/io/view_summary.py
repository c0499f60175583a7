"""What a view holds, in numbers: how many pixels or points, how far away, what is missing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class ViewSummary:
    """What one view holds.

    Attributes
    ----------
    kind : str
        "depth image" or "points".
    size : (int, int) or None
        Width and height of the image, pixels; None of points.
    points : int
        Pixels with a depth, or points.
    no_return : int or None
        Pixels of depth 0, or points at (0, 0, 0); None if these were left out before they were counted.
    not_finite : int
        Pixels or points that are NaN or infinite.
    distance : (float, float) or None
        The least and the greatest, metres: of an image the depth along the camera's z axis, of points the
        distance from the origin of their frame; None if there are none.
    corners : (2, 3) ndarray or None
        The low and the high corner of the points in their own frame, metres; None of images.
    intrinsics : (float, float, float, float) or None
        Focal lengths fx, fy and principal point cx, cy of the image, pixels; None of points, and if they are
        not known.
    colors : bool
        Whether there are colours.
    labels : int or None
        How many labels the mask has beside 0; None without a mask.
    points_in_mask : int or None
        Pixels with a depth inside the mask; None without a mask.
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


def summarize_view(view: View, no_return: int | None = None) -> ViewSummary:
    """Return what a view holds; of points the caller may know how many were no returns."""
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
    )
