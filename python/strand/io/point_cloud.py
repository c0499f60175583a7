"""What a point cloud file says: points, their colours, and where they were seen from."""

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
        In the frame that the file or its reader means, metres; some may not be finite.
    colors : (N, 3) ndarray, or None
        Red, green and blue: uint8, or floats from 0 to 1.
    viewpoint : (3,) ndarray, or None
        Where the file says that the points were seen from, in their frame, metres.
    """

    points: NDArray[Any]
    colors: NDArray[Any] | None = None
    viewpoint: Array | None = None

    @property
    def numbers(self) -> int:
        """How many numbers a view of it holds."""
        return self.points.size * (1 if self.colors is None else 2)

    def make_view(self, pose: Array) -> View:
        """Return a view of points in the camera frame, with the camera-to-world pose (4, 4).

        Points that are not finite are left out, and counted in `View.dropped`.

        Raises
        ------
        ValueError
            If the pose is not a rigid motion, or colours are not from 0 to 1.
        """
        finite = np.isfinite(self.points).all(axis=1)
        colors = None if self.colors is None else self.colors[finite]
        return View(self.points[finite], pose, int((~finite).sum()), colors)

    def make_view_from(self, viewpoint: Array) -> View:
        """Return a view of points in the world frame, seen from there (3,)."""
        pose = np.eye(4)
        pose[:3, 3] = viewpoint
        return PointCloud(self.points - viewpoint, self.colors).make_view(pose)


def scale_colors(numbers: NDArray[Any], whole: bool) -> NDArray[Any]:
    """Return the colours that a file writes as numbers.

    Parameters
    ----------
    numbers : (N, 3) ndarray
        Red, green and blue.
    whole : bool
        Whether they are whole numbers from 0 to 255. Others are from 0 to 1 if none is larger, else from 0 to
        255.

    Returns
    -------
    (N, 3) ndarray
        Uint8, or floats from 0 to 1.

    Raises
    ------
    ValueError
        If one is negative, above 255 or not finite.
    """
    least, most = (numbers.min(), numbers.max()) if numbers.size else (0, 0)
    if not (least >= 0 and most <= 255):
        raise ValueError(f"colours: expected numbers from 0 to 1, or from 0 to 255, got {least} to {most}")
    return numbers.astype(np.uint8) if whole else numbers / (255.0 if most > 1 else 1.0)
