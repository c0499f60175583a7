"""The points of all views, and the arcs that are traced in them."""

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

_TRACED_POINTS = 20  # points per voxel, two radii wide, that tracing needs; fits take more
_DENSER = 3  # points that a fit of few points takes over those that tracing needs


@dataclass(frozen=True, eq=False)
class Clouds:
    """The points of each view in the world frame, at the reported poses.

    Attributes
    ----------
    points : list of (N_v, 3) ndarray
        Metres.
    viewpoints : (V, 3) ndarray
        The cameras' centres, metres.
    reference : int
        The view whose pose stays as reported.
    bounds : Box or None
        The extraction range that the points were cropped to, metres.
    """

    points: list[Array]
    viewpoints: Array
    reference: int
    bounds: Box | None

    @classmethod
    def from_views(cls, views: Sequence[View], bounds: Box | None, reference: int | None = None) -> Clouds:
        """Return the views' points; the middle view is the reference if none is given."""
        viewpoints = np.array([view.viewpoint for view in views])
        points = [_core.copy_constant(view.world_points) for view in views]
        return cls(points, viewpoints, len(views) // 2 if reference is None else reference, bounds)

    @property
    def hull(self) -> tuple[Array, Array] | None:
        """Low and high corner of the extraction range's box along the world's axes, metres."""
        return None if self.bounds is None else self.bounds.find_hull()

    def thin(self, step: int) -> Clouds:
        """Return every `step`-th point of each view."""
        if step == 1:
            return self
        return replace(self, points=[_core.copy_constant(cloud[::step]) for cloud in self.points])

    def find_step(self, radius: float) -> int:
        """Return the largest step of `thin` that leaves enough points for tracing."""
        count = sum(map(len, self.points))
        occupied = _core.count_voxels(self.points, 2.0 * radius)
        return max(round(count / (_TRACED_POINTS * max(occupied, 1))), 1)

    def find_fit_step(self, radius: float) -> int:
        """Return the largest step of `thin` that leaves enough points for fits."""
        return max(self.find_step(radius) // _DENSER, 1)

    def thin_for_tracing(self, radius: float) -> Clouds:
        """Return as few points as tracing needs."""
        return self.thin(self.find_step(radius))


@dataclass(frozen=True, eq=False)
class Arcs:
    """Traced stretches of rope.

    Attributes
    ----------
    nodes : list of (M, 3) ndarray
        Ordered nodes of each, metres.
    classes : list of int
        Each arc's class of radius: an index into the radii that ropes may have.
    """

    nodes: list[Array]
    classes: list[int]

    def select(self, chosen: Iterable[object]) -> Arcs:
        """Return the arcs whose value in `chosen` is true."""
        chosen = list(chosen)
        return Arcs(list(compress(self.nodes, chosen)), list(compress(self.classes, chosen)))
