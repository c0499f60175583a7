"""The layout of a scene: where its cameras stand, a wall instead of the table, and bars before the ropes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from strand.support.checks import (
    Array,
    check_finite_array,
    check_integer,
    check_number,
    check_positive,
    check_sequence,
)
from strand.synthetic.camera import TABLE_ELEVATION, camera_pose, find_least_distance, spread_azimuths
from strand.synthetic.rendering import TABLE, check_rope, check_size
from strand.synthetic.shapes import LONGEST

_LEAST_DISTANCE = 76.0  # radii, from a camera to the origin: 0.32 m for a rope 8.4 mm thick


@dataclass(frozen=True, eq=False)
class Layout:
    """Places of a scene's cameras, wall and bars.

    Attributes
    ----------
    distance : float, optional
        From the origin to the cameras, metres; 76 rope radii by default. Cameras stand farther away where
        a view would otherwise cut a rope off.
    elevation : float, optional
        Angle of the cameras above the table, radians; 50 degrees by default, 0 before a wall.
    wall : float, optional
        Replaces the table by a wall at x = -wall, metres, for ropes that hang. The cameras look along -x,
        from azimuths of -40 to 40 degrees.
    bars : sequence of ((M, 3) array_like, float)
        Round bars that are not ropes: the nodes and the radius of each, metres.

    Raises
    ------
    TypeError
        If a value has the wrong type.
    ValueError
        If `distance`, `wall` or a bar's radius is not positive, `elevation` is not finite, or a bar's nodes
        are not as `render_depth` accepts them.
    """

    distance: float | None = None
    elevation: float | None = None
    wall: float | None = None
    bars: Sequence[tuple[ArrayLike, float]] = ()

    def __post_init__(self) -> None:
        if self.distance is not None:
            object.__setattr__(self, "distance", check_positive("distance", self.distance, LONGEST))
        if self.elevation is not None:
            object.__setattr__(self, "elevation", check_number("elevation", self.elevation))
        if self.wall is not None:
            object.__setattr__(self, "wall", check_positive("wall", self.wall, LONGEST))
        pairs = check_sequence("bars", self.bars, "pairs")
        object.__setattr__(
            self, "bars", tuple(_check_bar(f"bars[{i}]", pair) for i, pair in enumerate(pairs))
        )

    def place_cameras(
        self, views: int, nodes: Array, radius: float, size: tuple[int, int]
    ) -> tuple[Array, float]:
        """Return (V, 4, 4) poses of cameras that see all nodes of the ropes, and their distance, metres."""
        views, size = check_integer("views", views, 1), check_size(size)
        nodes = check_finite_array("nodes", nodes, ("N", 3))
        radius = check_positive("radius", radius, LONGEST)
        azimuths = spread_azimuths(views, self.wall is not None)
        elevation = self.elevation
        if elevation is None:
            elevation = TABLE_ELEVATION if self.wall is None else 0.0
        least = find_least_distance(nodes, radius, azimuths, elevation, size)
        distance = max(_LEAST_DISTANCE * radius if self.distance is None else self.distance, least)
        return np.stack([camera_pose(azimuth, distance, elevation) for azimuth in azimuths]), distance

    def find_background(self, distance: float) -> tuple[Array, float]:
        """Return the rigid motion that takes the table or the wall to z = 0, and its side, metres.

        `distance` is the cameras' distance from the origin, metres.
        """
        distance = check_positive("distance", distance)
        if self.wall is None:
            return np.eye(4), max(TABLE, 3.0 * distance)
        motion = np.eye(4)
        motion[:3, :3] = np.roll(np.eye(3), 1, axis=1)
        motion[2, 3] = self.wall
        return motion, 4.0 * (distance + self.wall)


def _check_bar(name: str, bar: tuple[ArrayLike, float]) -> tuple[Array, float]:
    if not isinstance(bar, (tuple, list)) or len(bar) != 2:
        raise ValueError(f"{name}: expected a pair of nodes and a radius")
    return check_rope(name, bar[0]), check_positive(name, bar[1], LONGEST)
