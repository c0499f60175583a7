"""What the cameras saw of a place: something there, something before it, or nothing but what lies behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand.view import Array, View

# views are gridded by direction; a cell is as wide as this many points lie apart
_CELL = 1.6
# directions farther than this from a view's middle, as tangents, are not gridded
_WIDEST = 3.0
# how far beyond what will be asked for directions are gridded, as tangents
_MARGIN = 0.1
# how far in front of or behind a place something must be, in radii
_APART = 1.0

UNKNOWN, HIDDEN, SUPPORTED, EMPTY = range(4)


@dataclass(frozen=True, eq=False)
class _Buffer:
    """Least distance of a view's points in each direction, seen from its camera.

    Directions are gridded on the plane at distance 1 before the camera at a right angle to `axes[2]`.
    """

    axes: Array
    cell: float
    low: Array
    nearest: Array


@dataclass(frozen=True, eq=False)
class Sight:
    """What all views saw, for questions about places.

    Use `Sight.of`.
    """

    buffers: tuple[_Buffer | None, ...]
    cameras: Array

    @classmethod
    def of(cls, views: Sequence[View], poses: Sequence[Array], about: Sequence[View] = ()) -> Sight:
        """Grid the views by direction.

        Parameters
        ----------
        views : sequence of View
            With all that they saw, what lies beyond the strings too: that a ray reached the table says that
            nothing was before it.
        poses : sequence of (4, 4) ndarray
            Their camera-to-world poses.
        about : sequence of View, optional
            What of each view will be asked for: directions far from all of it are left out.

        Returns
        -------
        Sight
        """
        buffers = tuple(
            _buffer(view.points, near.points, pose[:3, :3])
            for view, near, pose in zip(views, about or views, poses, strict=True)
        )
        return cls(buffers, np.array([pose[:3, 3] for pose in poses]))

    def states(self, places: Array, radius: float) -> np.ndarray:
        """Say what each view saw of tubes about places.

        Parameters
        ----------
        places : (N, 3) ndarray
            Places of an axis in the world frame, metres.
        radius : float
            The tube's, metres.

        Returns
        -------
        (V, N) ndarray of int
            `SUPPORTED`: points about where the surface would be; `HIDDEN`: nothing but points in front of it;
            `EMPTY`: nothing but points behind it, so nothing is there; `UNKNOWN`: no points in that
            direction.
        """
        states = np.full((len(self.buffers), len(places)), UNKNOWN)
        for number, (buffer, camera) in enumerate(zip(self.buffers, self.cameras, strict=True)):
            if buffer is not None:
                states[number] = _states(buffer, places - camera, radius)
        return states

    def empty(self, places: Array, radius: float) -> np.ndarray:
        """(N,) Whether the views say that there is no string: some saw past the place, and none saw one."""
        states = self.states(places, radius)
        past, there = (states == EMPTY).sum(axis=0), (states == SUPPORTED).sum(axis=0)
        return np.asarray(past > there)

    def hidden(self, places: Array, radius: float) -> np.ndarray:
        """(N,) Whether no view could have seen a string there."""
        states = self.states(places, radius)
        return np.asarray(((states == HIDDEN) | (states == UNKNOWN)).all(axis=0))


def _buffer(points: Array, about: Array, rotation: Array) -> _Buffer | None:
    """Grid one view's points, which are in the camera frame; None if there are hardly any."""
    range_of = np.sqrt(np.einsum("ij,ij->i", about, about))
    about, range_of = about[range_of > 0], range_of[range_of > 0]
    if len(about) < 16:
        return None
    middle = (about / range_of[:, None]).mean(axis=0)
    length = np.linalg.norm(middle)
    if length < 0.1:
        return None
    forward = middle / length
    side = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(forward, side), forward])
    asked, _ = _directions(about, axes)
    flat, ahead = _directions(points, axes)
    near = ((flat > asked.min(axis=0) - _MARGIN) & (flat < asked.max(axis=0) + _MARGIN)).all(axis=1)
    flat, seen = flat[near], points[ahead][near]
    if len(flat) < 16:
        return None
    distance = np.sqrt(np.einsum("ij,ij->i", seen, seen))
    cell = _CELL * _spacing(flat)
    low = flat.min(axis=0)
    place = ((flat - low) / cell).astype(np.int64)
    shape = place.max(axis=0) + 1
    if shape.prod() > 4 * 10**7:
        return None
    number = place[:, 0] * shape[1] + place[:, 1]
    nearest = np.full(shape.prod(), np.inf)
    np.minimum.at(nearest, number, distance)
    return _Buffer(axes @ rotation.T, float(cell), low, nearest.reshape(shape))


def _directions(points: Array, axes: Array) -> tuple[Array, np.ndarray]:
    """(N', 2) Directions of the points that are not far to the side, and (N,) which those are."""
    depth = points @ axes[2]
    ahead = depth > 0
    flat = (points[ahead] @ axes[:2].T) / depth[ahead, None]
    aside = np.abs(flat).max(axis=1) < _WIDEST
    ahead[ahead] = aside
    return flat[aside], ahead


def _spacing(flat: Array) -> float:
    """Distance between neighbours among (N, 2) directions: the side of the area that each has to itself."""
    low, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    area = float(max(extent.prod(), 1e-4 * extent.max() ** 2, 1e-18))
    # from the area of the box to that of the cells, a few points wide, that hold points
    for _ in range(2):
        cell = 3.0 * np.sqrt(area / len(flat))
        place = ((flat - low) / cell).astype(np.int64)
        width = int(place[:, 1].max()) + 1
        taken = np.zeros((int(place[:, 0].max()) + 1) * width, dtype=bool)
        taken[place[:, 0] * width + place[:, 1]] = True
        area = float(taken.sum() * cell**2)
    return float(np.sqrt(area / len(flat)))


def _states(buffer: _Buffer, offset: Array, radius: float) -> np.ndarray:
    """(N,) What one view saw of places, which are given relative to its camera in the world frame."""
    reach = np.linalg.norm(offset, axis=1) - radius
    local = offset @ buffer.axes.T
    ahead = local[:, 2] > np.maximum(reach, 1e-12) / np.hypot(1.0, _WIDEST)
    flat = local[:, :2] / np.where(ahead, local[:, 2], 1.0)[:, None]
    place = np.floor((flat - buffer.low) / buffer.cell).astype(np.int64)
    shape = np.array(buffer.nearest.shape)
    inside = ahead & (place >= 0).all(axis=1) & (place < shape).all(axis=1)
    at = np.where(inside[:, None], place, 0)
    nearest = np.where(inside, buffer.nearest[at[:, 0], at[:, 1]], np.inf)
    states = np.full(len(offset), SUPPORTED)
    states[nearest < reach - _APART * radius] = HIDDEN
    states[nearest > reach + _APART * radius] = EMPTY
    states[np.isinf(nearest)] = UNKNOWN
    return states
