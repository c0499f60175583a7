"""What the default method works on: clouds of points by view, arcs, joins of their ends, chains."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

import strand._core as _core
from strand.support.checks import Array
from strand.views.box import Box
from strand.views.view import View

Pair = tuple[int, int]
"""Two ends of arcs: end 2k is the first node of arc k, 2k + 1 its last."""

# mean number of points in a voxel of two radii that is enough to trace arcs; ropes are fitted to all points
_TRACEABLE = 20


@dataclass(frozen=True, eq=False)
class Clouds:
    """What the fit works on: every view's points in the world frame as reported.

    Attributes
    ----------
    points : list of (N_v, 3) ndarray
        Metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres, metres.
    reference : int
        The view that stays where it is.
    bounds : Box or None
        The extraction range that the points were cut to, metres.
    """

    points: list[Array]
    viewpoints: Array
    reference: int
    bounds: Box | None

    @classmethod
    def of(cls, views: Sequence[View], bounds: Box | None, reference: int | None = None) -> Clouds:
        """Return the views' points; the middle view is the reference if none is given."""
        viewpoints = np.array([view.viewpoint for view in views])
        points = [_core.constant_copy(view.world_points) for view in views]
        return cls(points, viewpoints, len(views) // 2 if reference is None else reference, bounds)

    @property
    def hull(self) -> tuple[Array, Array] | None:
        """Corners of the least box along the world's axes that holds the extraction range, metres."""
        return None if self.bounds is None else self.bounds.hull()

    def every(self, step: int) -> Clouds:
        """Return every n-th point of each view."""
        if step == 1:
            return self
        return replace(self, points=[_core.constant_copy(cloud[::step]) for cloud in self.points])

    def step(self, radius: float) -> int:
        """Return the n of which every n-th point of each view is enough to trace arcs."""
        count = sum(map(len, self.points))
        occupied = _core.occupied_voxels(self.points, 2.0 * radius)
        return max(round(count / (_TRACEABLE * max(occupied, 1))), 1)

    def thinned(self, radius: float) -> Clouds:
        """Return every n-th point of each view, n as large as tracing allows."""
        return self.every(self.step(radius))


@dataclass(frozen=True, eq=False)
class Arcs:
    """Stretches of rope.

    Attributes
    ----------
    nodes : list of (M, 3) ndarray
        Ordered nodes of each, metres.
    classes : list of int
        The class of its radius: a number into the radii that ropes may have.
    """

    nodes: list[Array]
    classes: list[int]

    def only(self, chosen: Iterable[object]) -> Arcs:
        """Return those for which something is true."""
        chosen = list(chosen)
        return Arcs(list(compress(self.nodes, chosen)), list(compress(self.classes, chosen)))
