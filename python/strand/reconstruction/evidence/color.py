"""Colours of arcs at their ends: the arcs of one rope have the same colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.geometry.polyline import path_length
from strand.support.checks import Array
from strand.views.view import View

_STRETCH = 6.0  # radii: length of the last stretch of an arc, whose points give the colour of its end
_MIN_POINTS = 8  # points on the stretch
_REACH = 0.75  # radii between the points' foot points and the nodes of the stretch
_MIN_SCATTER = 0.02  # of colours from 0 to 1: finer differences do not count
_WEIGHT = 0.5  # cost of a difference as large as the scatter within arcs, in the unit of `Config.linking`


def collect_colors(views: Sequence[View]) -> Array | None:
    """Return the colours of all views' points in order, NaN where unknown; None if no view has colours."""
    if all(view.colors is None for view in views):
        return None
    return np.concatenate(
        [np.full(view.points.shape, np.nan) if view.colors is None else view.colors for view in views]
    )


@dataclass(frozen=True, eq=False)
class ArcColors:
    """Colours along fitted arcs.

    Attributes
    ----------
    places : (N, 3) ndarray
        Foot points of coloured points on the axes, metres.
    colors : (N, 3) ndarray
        The points' colours, scaled so that they scatter by 1 in every direction within arcs.
    """

    places: Array
    colors: Array

    @classmethod
    def from_fit(cls, fit: TubeFit, colors: Array) -> ArcColors:
        """Return the colours along the arcs of a fit, given those of its points, (N, 3) from 0 to 1."""
        colored = fit.inlier & np.isfinite(colors).all(axis=1)
        places, shades, about = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty((0, 3))]
        for number, control in enumerate(fit.curves):
            mine = colored & (fit.curve == number)
            if mine.any():
                curve = Curve.whole(control)
                places.append(curve.place_at(curve.arc_length_at(fit.parameter[mine])))
                shades.append(colors[mine])
                about.append(colors[mine] - colors[mine].mean(axis=0))
        scatter = np.concatenate(about)
        spread = scatter.T @ scatter / max(len(scatter), 1) + _MIN_SCATTER**2 * np.eye(3)
        scale = np.linalg.inv(np.linalg.cholesky(spread))
        return cls(np.concatenate(places), np.concatenate(shades) @ scale.T)

    def price_joins(self, arcs: Sequence[Array], radius: float) -> Array:
        """Return the cost of joining ends of arcs for the difference of their colours.

        Parameters
        ----------
        arcs : sequence of (M, 3) ndarray
            Ordered nodes, metres.
        radius : float
            The ropes', metres.

        Returns
        -------
        (E, E) ndarray
            For each pair of ends: end 2k is the first node of arc k and 2k + 1 its last. 0 where a colour is
            unknown.
        """
        mean = np.full((2 * len(arcs), 3), np.nan)
        for end in range(len(mean)):
            nodes = arcs[end // 2][:: 1 if end % 2 == 0 else -1]
            nodes = nodes[path_length(nodes) < _STRETCH * radius]
            low, high = nodes.min(axis=0) - _REACH * radius, nodes.max(axis=0) + _REACH * radius
            about = np.flatnonzero(((self.places > low) & (self.places < high)).all(axis=1))
            away = np.linalg.norm(self.places[about, None] - nodes[None], axis=2).min(axis=1, initial=np.inf)
            near = about[away < _REACH * radius]
            if len(near) >= _MIN_POINTS:
                mean[end] = self.colors[near].mean(axis=0)
        return np.asarray(np.nan_to_num(_WEIGHT * ((mean[:, None] - mean[None]) ** 2).sum(axis=2)))
