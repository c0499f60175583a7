"""A pinhole camera: where a point of the camera frame is seen, and where a pixel looks."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array

Pixels = Array | NDArray[np.integer[Any]]
"""Rows or columns of pixels."""


class Pinhole(NamedTuple):
    """A pinhole camera, pixels. An integer pixel is a pixel centre.

    Attributes
    ----------
    focal : (float, float)
        Focal lengths.
    center : (float, float)
        Principal point: column and row.
    """

    focal: tuple[float, float]
    center: tuple[float, float]

    @classmethod
    def from_matrix(cls, matrix: Array) -> Pinhole:
        """Return the camera of a (3, 3) matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]."""
        fx, fy, cx, cy = (float(matrix[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
        return cls((fx, fy), (cx, cy))

    def project(self, points: Array) -> Array:
        """Return the (N, 2) columns and rows at which points (N, 3) of the camera frame are seen."""
        (fx, fy), (cx, cy) = self
        x, y, z = points.T
        pixels = np.empty((len(points), 2))
        pixels[:, 0] = fx * x / z + cx
        pixels[:, 1] = fy * y / z + cy
        return pixels

    def lift(self, rows: Pixels, columns: Pixels, z: Array) -> Array:
        """Return the points (..., 3) of the camera frame that pixels show at depths z, metres."""
        (fx, fy), (cx, cy) = self
        points = np.empty((*np.shape(z), 3))
        points[..., 0] = (columns - cx) * z / fx
        points[..., 1] = (rows - cy) * z / fy
        points[..., 2] = z
        return points

    def cast_rays(self, rows: Pixels, columns: Pixels) -> Array:
        """Return the rays (..., 3) of pixels in the camera frame, as far as a depth of one."""
        (fx, fy), (cx, cy) = self
        rays = np.ones((*np.shape(rows), 3))
        rays[..., 0] = (columns - cx) / fx
        rays[..., 1] = (rows - cy) / fy
        return rays

    def averaged(self, side: int) -> Pinhole:
        """Return the camera of an image whose pixels are squares of `side` by `side` pixels of this one."""
        (fx, fy), (cx, cy) = self
        shift = 0.5 * (side - 1)
        return Pinhole((fx / side, fy / side), ((cx - shift) / side, (cy - shift) / side))

    def magnified(self, factor: int, corner: tuple[float, float]) -> Pinhole:
        """Return the camera of an image that begins at a column and row, with finer pixels.

        A pixel of this camera is a square of `factor` by `factor` of them.
        """
        (fx, fy), (cx, cy) = self
        shift = 0.5 * (factor - 1)
        center = ((cx - corner[0]) * factor + shift, (cy - corner[1]) * factor + shift)
        return Pinhole((fx * factor, fy * factor), center)

    def convert(self, pixels: Array, other: Pinhole) -> Array:
        """Return the (N, 2) columns and rows of another camera's pixels in this one, both at one pose."""
        slopes = (pixels - np.array(other.center)) / np.array(other.focal)
        return np.asarray(slopes * np.array(self.focal) + np.array(self.center))
