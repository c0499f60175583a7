"""The content of a point cloud file: points, colours and the camera's viewpoint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points of a file.

    Attributes
    ----------
    points : (N, 3) ndarray of float
        Metres, in the camera or world frame: the caller knows which. Some may not be finite.
    colors : (N, 3) ndarray, or None
        Red, green and blue: uint8, or floats from 0 to 1.
    viewpoint : (3,) ndarray, or None
        The camera's position by the file, in the frame of the points, metres.
    """

    points: NDArray[Any]
    colors: NDArray[Any] | None = None
    viewpoint: Array | None = None

    @property
    def numbers(self) -> int:
        """Number of floats in a view of the cloud."""
        return self.points.size * (1 if self.colors is None else 2)

    def make_view(self, pose: Array, stamp: float | None = None) -> View:
        """Return a view with this (4, 4) camera-to-world pose; the points are in the camera frame.

        The view drops points that are not finite, and counts them in `View.dropped`.
        """
        finite = np.isfinite(self.points).all(axis=1)
        colors = None if self.colors is None else self.colors[finite]
        return View(self.points[finite], pose, int((~finite).sum()), colors, stamp=stamp)

    def make_view_from(self, viewpoint: Array) -> View:
        """Return a view from this (3,) viewpoint, metres; the points are in the world frame."""
        pose = np.eye(4)
        pose[:3, 3] = viewpoint
        return PointCloud(self.points - viewpoint, self.colors).make_view(pose)


def scale_colors(numbers: NDArray[Any], whole: bool) -> NDArray[Any]:
    """Return (N, 3) colours of a file as uint8 if they are `whole` numbers, else as floats from 0 to 1.

    Floats above 1 mean that the file's colours go from 0 to 255.
    """
    least, most = (numbers.min(), numbers.max()) if numbers.size else (0, 0)
    if not (least >= 0 and most <= 255):
        raise ValueError(f"colours: expected numbers from 0 to 1, or from 0 to 255, got {least} to {most}")
    return numbers.astype(np.uint8) if whole else numbers / (255.0 if most > 1 else 1.0)
