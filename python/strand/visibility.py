"""What the cameras saw of a place: something there, something before it, or nothing but what lies behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand import _core
from strand.view import Array, View, saw


@dataclass(frozen=True, eq=False)
class Sight:
    """What all views saw, for questions about places.

    Use `Sight.of`.
    """

    _views: _core.Visibility

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
        return cls(
            _core.Visibility([saw(view) for view in views], [view.points for view in about or views], poses)
        )

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
            `OCCUPIED`, `OCCLUDED`, `FREE` or `UNKNOWN` of `_core.Visibility`.
        """
        return self._views.states(places, radius)

    def free(self, places: Array, radius: float) -> np.ndarray:
        """(N,) Whether the views say that there is no string: some saw past the place, and fewer saw one."""
        return self._views.free(places, radius)

    def seen_through(self, places: Array, direction: Array, radius: float) -> np.ndarray:
        """(N,) Whether some view saw through the side that it faces of a tube along a unit vector."""
        return self._views.seen_through(places, direction, radius)

    def occluded(self, places: Array, radius: float) -> np.ndarray:
        """(N,) Whether no view could have seen a string there."""
        return self._views.occluded(places, radius)
