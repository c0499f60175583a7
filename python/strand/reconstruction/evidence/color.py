"""Colours of arcs at their ends: arcs of one rope look alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.geometry.polyline import path_length
from strand.support.checks import Array
from strand.views.view import View

# an end has the colour of the points on its last stretch: so long, at least so many points, whose foot points
# are this near to the nodes; lengths in radii
_STRETCH, _FEWEST, _NEAR = 6.0, 8, 0.75
# colours are not told apart more finely than this, from 0 to 1
_FINEST = 0.02
# what a difference as large as the spread of colour within arcs costs, in the unit of the joins' costs
_WEIGHT = 0.5


def colors_of(views: Sequence[View]) -> Array | None:
    """Colours of all views' points one after another, NaN for those without; None if no view has any."""
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
        The foot points of coloured points on the axes, metres.
    colors : (N, 3) ndarray
        Their colours, scaled so that within arcs they scatter by 1 in every direction.
    """

    places: Array
    colors: Array

    @classmethod
    def of(cls, fit: TubeFit, colors: Array) -> ArcColors:
        """Return the colours along the arcs of a fit, given those of its points, (N, 3) from 0 to 1."""
        coloured = fit.inlier & np.isfinite(colors).all(axis=1)
        places, shades, about = [np.empty((0, 3))], [np.empty((0, 3))], [np.empty((0, 3))]
        for number, control in enumerate(fit.curves):
            mine = coloured & (fit.curve == number)
            if mine.any():
                curve = Curve.whole(control)
                places.append(curve.at(curve.arc_length_at(fit.parameter[mine]))[0])
                shades.append(colors[mine])
                about.append(colors[mine] - colors[mine].mean(axis=0))
        scatter = np.concatenate(about)
        spread = scatter.T @ scatter / max(len(scatter), 1) + _FINEST**2 * np.eye(3)
        scale = np.linalg.inv(np.linalg.cholesky(spread))
        return cls(np.concatenate(places), np.concatenate(shades) @ scale.T)

    def join_costs(self, arcs: Sequence[Array], radius: float) -> Array:
        """Return what it costs to join ends of arcs for the difference of their colours.

        Parameters
        ----------
        arcs : sequence of (M, 3) ndarray
            Ordered nodes, metres.
        radius : float
            The ropes' radius, metres.

        Returns
        -------
        (E, E) ndarray
            For each pair of ends, 2k the first node of arc k and 2k + 1 its last; 0 where a colour is not
            known.
        """
        mean = np.full((2 * len(arcs), 3), np.nan)
        for end in range(len(mean)):
            nodes = arcs[end // 2][:: 1 if end % 2 == 0 else -1]
            nodes = nodes[path_length(nodes) < _STRETCH * radius]
            low, high = nodes.min(axis=0) - _NEAR * radius, nodes.max(axis=0) + _NEAR * radius
            about = np.flatnonzero(((self.places > low) & (self.places < high)).all(axis=1))
            apart = np.linalg.norm(self.places[about, None] - nodes[None], axis=2).min(axis=1, initial=np.inf)
            near = about[apart < _NEAR * radius]
            if len(near) >= _FEWEST:
                mean[end] = self.colors[near].mean(axis=0)
        return np.asarray(np.nan_to_num(_WEIGHT * ((mean[:, None] - mean[None]) ** 2).sum(axis=2)))
