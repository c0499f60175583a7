"""A plane in space, such as a table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from strand.support.checks import Array


class Plane(NamedTuple):
    """A plane as kernels take it.

    Attributes
    ----------
    normal : (3,) ndarray
        Unit normal towards the camera.
    offset : float
        `normal @ x` of points x on the plane, metres.
    """

    normal: Array
    offset: float

    def measure_heights(self, points: Array) -> Array:
        """Return how far (..., 3) points are above the plane, (...) metres."""
        return np.asarray(points @ self.normal - self.offset)

    @property
    def axes(self) -> Array:
        """(3, 2) Two unit vectors at right angles in the plane."""
        aside = np.cross(np.eye(3)[np.abs(self.normal).argmin()], self.normal)
        aside /= np.linalg.norm(aside)
        return np.column_stack([aside, np.cross(self.normal, aside)])

    def moved(self, motion: Array) -> Plane:
        """Return the plane after a (4, 4) rigid motion."""
        normal = motion[:3, :3] @ self.normal
        return Plane(normal, float(self.offset + normal @ motion[:3, 3]))
