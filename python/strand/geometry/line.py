"""A line: the ordered nodes of a centreline, with a radius, and the geometry along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand._core import TubeQueries
from strand.geometry import bending
from strand.geometry.curve import Curve
from strand.geometry.frames import carry_along_nodes, carry_directions, choose_side, fill_lost_tangents
from strand.geometry.mesh import make_tube_mesh
from strand.geometry.nearest import Nearest, find_nearest
from strand.geometry.polyline import check_node_values, find_runs, interpolate, path_length
from strand.support.checks import (
    Array,
    check_bool,
    check_finite_array,
    check_instance,
    check_integer,
    check_nonnegative,
    check_numbers,
    check_radius,
    freeze_array,
    to_array,
)
from strand.support.copies import copy_fields_with
from strand.support.lazy import lazy_property

if TYPE_CHECKING:
    from typing_extensions import Self

_MAX_COORDINATE = 1e75  # metres: products of lengths stay finite
_MAX_NODES = 1_000_000  # of a resampled line
_NODE_VALUES: dict[str, tuple[int, ...]] = {"covariance": (3, 3), "points_seen": (), "views_seen": ()}
"""Optional fields with a value for each node, and the shape of one value."""


@dataclass(frozen=True, eq=False)
class Line:
    """The centreline of a rope: ordered nodes and a radius. Its arrays are read-only.

    Parameters
    ----------
    points : (M, 3) array_like of float
        Nodes in order, world frame, metres, M >= 2. No two in a row are equal.
    radius : float
        Radius of the rope, metres.
    closed : bool
        Whether the last node joins the first, as in a ring.
    curve : Curve, optional
        Smooth curve through the nodes. With it, `at` and `tangents` follow the curve; without it they follow
        the straight segments between nodes.
    covariance : (M, 3, 3) ndarray, optional
        Covariance of each node, m^2. With it, curvature is that of a window, see `curvature_vector_at`.
    points_seen, views_seen : (M,) ndarray of int, optional
        Numbers of points and of views that support each node; 0 where the line only bridges a gap.
    radius_sd : float
        Standard deviation of the radius, metres; 0 if it is not known.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind; of methods too.
    ValueError
        If an array has a wrong shape or is not finite, or a number is out of range; of methods too. Also if
        `points` has equal neighbours or coordinates above 1e75 m.

    Examples
    --------
    >>> import numpy as np
    >>> from strand.geometry.line import Line
    >>> line = Line(np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.4, 0.0]]), radius=0.004)
    >>> round(line.length, 3), line.at(0.5).round(3).tolist()
    (0.7, [0.3, 0.2, 0.0])
    """

    points: Array
    radius: float
    closed: bool = False
    curve: Curve | None = None
    covariance: Array | None = None
    points_seen: NDArray[np.int64] | None = None
    views_seen: NDArray[np.int64] | None = None
    radius_sd: float = 0.0

    def __post_init__(self) -> None:
        points = check_finite_array("points", self.points, ("N", 3))
        if len(points) < 2:
            raise ValueError(f"points: expected at least two nodes, got {len(points)}")
        if np.abs(points).max() > _MAX_COORDINATE:
            raise ValueError(f"points: expected coordinates up to {_MAX_COORDINATE:g} m")
        object.__setattr__(self, "points", freeze_array(points))
        object.__setattr__(self, "radius", check_radius(self.radius))
        object.__setattr__(self, "closed", check_bool("closed", self.closed))
        object.__setattr__(self, "radius_sd", check_nonnegative("radius_sd", self.radius_sd))
        if self.curve is not None:
            check_instance("curve", self.curve, Curve)
        for name, shape in _NODE_VALUES.items():
            if getattr(self, name) is not None:
                value = check_node_values(name, getattr(self, name), (len(points), *shape), counts=not shape)
                object.__setattr__(self, name, freeze_array(value))
        if (np.diff(self._path_arcs) <= 0).any():
            raise ValueError("points: expected no two equal nodes in a row")

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self.length * 1e3:.1f} mm, radius {self.radius * 1e3:.2f} mm, "
            f"{'closed' if self.closed else 'open'}, {len(self.points)} nodes)"
        )

    @lazy_property
    def _path(self) -> Array:
        """The nodes; a closed line repeats the first one at the end."""
        return np.vstack([self.points, self.points[:1]]) if self.closed else self.points

    @lazy_property
    def _path_arcs(self) -> Array:
        """Arc length along the straight segments at each node of the path, metres."""
        return path_length(self._path)

    @property
    def length(self) -> float:
        """Arc length from end to end, or once around if closed, metres."""
        return float(self._path_arcs[-1]) if self.curve is None else self.curve.length

    @property
    def bridged(self) -> NDArray[np.bool_]:
        """(M,) Whether a node only bridges a gap: no point supports a radius or more of rope around it.

        All False if `points_seen` is not known.
        """
        bare = np.zeros(len(self.points), dtype=bool)
        if self.points_seen is not None:
            spacing = self.length / len(self.points)
            for start, stop in find_runs(self.points_seen == 0):
                bare[start:stop] = (stop - start) * spacing >= self.radius
        return bare

    @lazy_property
    def arc_length(self) -> Array:
        """(M,) Arc length from the first node to each node, metres."""
        if self.curve is not None:
            return np.linspace(0.0, self.curve.length, len(self.points))
        return self._path_arcs[: len(self.points)]

    @lazy_property
    def tangents(self) -> Array:
        """(M, 3) Unit tangents at the nodes, in their order; without `curve` by central differences."""
        return self._find_derivatives()[0]

    @lazy_property
    def curvature(self) -> Array:
        """(M,) Curvature at the nodes, 1/m: the length of `curvature_vector_at`.

        Without covariance and curve it is the second difference by arc length. The ends of an open line then
        repeat their neighbours' value; a line of two nodes has none.
        """
        if self.covariance is not None:
            bend = bending.fit_window(self.at, *self._place_windows(self.arc_length))[1]
            return np.asarray(np.linalg.norm(bend, axis=1))
        return np.asarray(np.linalg.norm(self._find_derivatives()[1], axis=1))

    def _place_windows(self, s: Array) -> tuple[Array, float]:
        """Return the centers of windows around places, kept inside an open line, and their half width."""
        reach = min(bending.REACH * self.radius, 0.5 * self.length)
        around = self.closed and self.curve is None
        return s if around else np.clip(s, reach, self.length - reach), reach

    def _find_derivatives(self) -> tuple[Array, Array]:
        """Return unit tangents and curvature vectors at the nodes."""
        if self.curve is not None:
            return self.curve.at(self.arc_length)[1:]
        return bending.find_node_derivatives(self._path, self.closed)

    def reversed(self) -> Self:
        """Return the same rope with its nodes in the other order; nothing is checked again."""
        rows = {name: getattr(self, name) for name in ("points", *_NODE_VALUES)}
        turned = {name: freeze_array(row[::-1]) for name, row in rows.items() if row is not None}
        curve = None if self.curve is None else self.curve.reversed()
        return copy_fields_with(self, curve=curve, **turned)

    def tube(self, sides: int = 16) -> tuple[Array, NDArray[np.int32]]:
        """Return the rope's surface as a closed triangle mesh.

        Each node has a ring of vertices. An open line has flat ends; a closed one needs three nodes.

        Parameters
        ----------
        sides : int
            Number of vertices of a ring, 3 to 1000. The mesh lies inside the rope: its volume is
            n / (2 pi) sin(2 pi / n) of the rope's, 0.974 for 16.

        Returns
        -------
        vertices : (K, 3) ndarray
            World frame, metres.
        triangles : (T, 3) ndarray of int32
            Numbers of vertices, anticlockwise seen from outside. Triangles intersect where the rope bends
            more tightly than its radius.
        """
        return make_tube_mesh(
            self.points, self.tangents, self.radius, self.closed, check_integer("sides", sides, 3, 1000)
        )

    def at(self, s: ArrayLike) -> Array:
        """Return the position at arc length `s`.

        Parameters
        ----------
        s : float or (...,) array_like
            Arc length from the first node, metres. Outside [0, length] it is clamped to the ends of an open
            line and wraps around a closed one.

        Returns
        -------
        (..., 3) ndarray
            World frame, metres: on `curve`, or without one on the straight segments between nodes.
        """
        at = self._clamp(s)
        if self.curve is not None:
            return self.curve.place_at(at.ravel()).reshape(*at.shape, 3)
        return np.stack([np.interp(at, self._path_arcs, self._path[:, k]) for k in range(3)], axis=-1)

    def tangent_at(self, s: ArrayLike) -> Array:
        """Return (..., 3) unit tangents at arc lengths `s`, as `at` takes them.

        They are those of `curve`, or without one lie between the nodes' `tangents`.
        """
        at = self._clamp(s)
        if self.curve is not None:
            return self.curve.at(at.ravel())[1].reshape(*at.shape, 3)
        mixed = self._interpolate_nodes(self._directions, at)
        lengths = np.linalg.norm(mixed, axis=-1, keepdims=True)
        # halfway around a line that turns back on itself there is none: take the one before
        lost = (lengths < 1e-9)[..., 0]
        mixed[lost] = self._directions[np.searchsorted(self._path_arcs, at[lost], side="right") - 1]
        lengths[lost] = 1.0
        return np.asarray(mixed / lengths)

    def interpolated(self, values: ArrayLike, s: ArrayLike) -> Array:
        """Return values of the nodes, such as `covariance`, at arc lengths `s`: linear between nodes.

        Parameters
        ----------
        values : (M, ...) array_like
            One real number or array for each node.
        s : float or (...,) array_like
            As for `at`; the result has its shape, followed by that of one value.
        """
        given = to_array("values", values)
        if given.dtype.kind not in "fiu":
            raise TypeError(f"values: expected real numbers, got dtype {given.dtype}")
        if not given.ndim or len(given) != len(self.points):
            raise ValueError(f"values: expected one for each of {len(self.points)} nodes, got {given.shape}")
        return self._interpolate_nodes(given.astype(np.float64), self._clamp(s))

    def _clamp(self, s: ArrayLike) -> Array:
        """Return arc lengths on the line: clamped to the ends of an open one, wrapped around a closed one."""
        at = check_numbers("s", s)
        if self.closed and self.curve is None:
            return np.asarray(np.mod(at, self.length))
        return np.asarray(np.clip(at, 0.0, self.length))

    def _interpolate_nodes(self, values: Array, s: Array) -> Array:
        """Return values of the nodes, linear between them, at arc lengths on the line."""
        known = self.arc_length
        if self.closed and self.curve is None:
            known, values = self._path_arcs, np.concatenate([values, values[:1]])
        return interpolate(s, known, values)

    @lazy_property
    def _directions(self) -> Array:
        """(M, 3) Unit tangents at the nodes, also where the nodes turn back on themselves."""
        return fill_lost_tangents(self._path, self.tangents, self.closed)

    def frames_at(self, s: ArrayLike) -> tuple[Array, Array]:
        """Return positions and twist-free frames at arc lengths `s`, as `at` takes them.

        These are Bishop's frames: they do not turn about the tangent along the rope, not even at inflections.
        They are carried from node to node by double reflection (Wang et al. 2008).

        Returns
        -------
        positions : (..., 3) ndarray
            World frame, metres: `at(s)`.
        rotations : (..., 3, 3) ndarray
            From the frame to the world. Columns are x along the tangent, y across it, and z = x × y. At the
            start z is as near to the world's z as possible; to the world's x if the rope starts along z.
            Once around a closed line the frame comes back turned about x.
        """
        at = self._clamp(s)
        flat = at.ravel()
        place, tangent = self.at(flat), self.tangent_at(flat)
        node = np.clip(np.searchsorted(self.arc_length, flat, side="right") - 1, 0, len(self.points) - 1)
        side = carry_directions(self._sides[node], self.points[node], self._directions[node], place, tangent)
        rotation = np.stack([tangent, np.cross(side, tangent), side], axis=-1)
        return place.reshape(*at.shape, 3), rotation.reshape(*at.shape, 3, 3)

    @lazy_property
    def _sides(self) -> Array:
        """(M, 3) The z axes of the frames at the nodes."""
        return carry_along_nodes(self.points, self._directions, choose_side(self._directions[0]))

    def curvature_vector_at(self, s: ArrayLike) -> Array:
        """Return curvature vectors at arc lengths `s`, as `at` takes them: towards where the rope bends.

        Returns
        -------
        (..., 3) ndarray
            Derivative of the tangent by arc length, 1/m. With covariances it is that of the quintic that fits
            best to four radii of rope on either side: errors of the nodes are no bends of the rope. Within
            four radii of an open end it has the value four radii from there. Without covariances it is that
            of `curve`, or between the nodes' values.
        """
        at = self._clamp(s)
        if self.covariance is not None:
            return bending.fit_window(self.at, *self._place_windows(at.ravel()))[1].reshape(*at.shape, 3)
        if self.curve is not None:
            return self.curve.at(at.ravel())[2].reshape(*at.shape, 3)
        return self._interpolate_nodes(self._find_derivatives()[1], at)

    def torsion_at(self, s: ArrayLike) -> Array:
        """Return the torsion at arc lengths `s`, as `at` takes them.

        Returns
        -------
        (...,) ndarray
            How fast the plane of the bend turns about the tangent, 1/m: positive for a right-handed helix, 0
            where the rope is straight, noise where it hardly bends. It is det(c', c'', c''') / |c' × c''|^2
            of the quintics of `curvature_vector_at` if there are covariances, else of `curve`. Without
            either it is the angle between the planes of three nodes each, over the length of the step that
            they share, and linear between the steps' middles.
        """
        at = self._clamp(s)
        if self.covariance is not None:
            return bending.find_window_torsion(self.at, *self._place_windows(at.ravel())).reshape(at.shape)
        if self.curve is not None:
            return bending.find_curve_torsion(self.curve, at)
        return bending.find_node_torsion(self.points, self.closed, at)

    def min_bend_radius(self) -> tuple[float, float]:
        """Find the tightest bend.

        Returns
        -------
        radius : float
            One over the curvature there, metres; infinite if the rope is straight.
        s : float
            Arc length of the first tightest place, metres; 0 if the rope is straight. With covariances, or
            without `curve`, it is a node.
        """
        if self.curve is not None and self.covariance is None:
            return bending.find_tightest_bend(self.curve, self.arc_length)
        worst = int(self.curvature.argmax())
        bend = float(self.curvature[worst])
        if bend * self.length <= bending.STRAIGHT:
            return float("inf"), 0.0
        return 1.0 / bend, float(self.arc_length[worst])

    def resample(self, n: int) -> Self:
        """Return the same rope with `n` evenly spaced nodes.

        Parameters
        ----------
        n : int
            At least 2, or 3 if closed; at most 1,000,000.

        Returns
        -------
        Line
            Of the same class, with nodes at `at(s)`. Covariances are linear between the old nodes,
            `points_seen` and `views_seen` those of the nearest old node. Without `curve` the new segments cut
            corners, so the line becomes shorter.
        """
        count = check_integer("n", n, 3 if self.closed else 2, _MAX_NODES)
        s = np.linspace(0.0, self.length, count, endpoint=not (self.closed and self.curve is None))
        numbers = np.arange(len(self.points), dtype=np.float64)
        nearest = np.rint(self._interpolate_nodes(numbers, s)).astype(np.intp)
        # on the last step of a closed line: the last node or the first
        beyond = s - self.arc_length[-1]
        nearest = np.where(beyond > 0, np.where(beyond < self.length - s, len(numbers) - 1, 0), nearest)
        return replace(
            self,
            points=self.at(s),
            covariance=None if self.covariance is None else self._interpolate_nodes(self.covariance, s),
            points_seen=None if self.points_seen is None else self.points_seen[nearest],
            views_seen=None if self.views_seen is None else self.views_seen[nearest],
        )

    def nearest(self, points: ArrayLike) -> Nearest:
        """Return the closest places of the line, as `at` has it; `Model.nearest` asks all chains.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        Nearest
        """
        return find_nearest(self._queries, [self.curve], points)

    def signed_distance(self, points: ArrayLike) -> Array:
        """Return the distance of points from the rope's surface; `Model.signed_distance` asks all chains.

        It is the distance from the straight segments between nodes, minus the radius: negative inside.
        Outside it is exact. Inside it is at most the way out, which is longer where the rope touches itself.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        (N,) ndarray
            Metres.
        """
        return self._queries.signed_distances(points)

    @lazy_property
    def _queries(self) -> TubeQueries:
        return make_queries([self])

    def _list_query_arcs(self) -> Array:
        """Return the arc length at each node of the path, as `at` takes it."""
        if self.curve is None:
            return self._path_arcs
        # the last step of a closed line is not part of the curve
        closing = np.diff(self._path_arcs[-2:]) if self.closed else np.empty(0)
        return np.append(self.arc_length, self.length + closing)


def make_queries(lines: Sequence[Line]) -> TubeQueries:
    """Return the hierarchy that answers queries about the tubes of lines."""
    return TubeQueries(
        [line._path for line in lines],
        [line._list_query_arcs() for line in lines],
        [line.radius for line in lines],
    )
