"""A chain: one rope's centreline as ordered nodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand._core import TubeQueries
from strand.geometry.bending import (
    REACH,
    STRAIGHT,
    least_bend,
    over_window,
    torsion_of_curve,
    torsion_of_nodes,
    torsion_over_window,
)
from strand.geometry.curve import Curve
from strand.geometry.frames import carried, least_turned, node_frames
from strand.geometry.mesh import tube_mesh
from strand.geometry.polyline import between, runs
from strand.ropes.crossings import Crossing, find_crossings, listed_crossings
from strand.ropes.doubt import Doubt
from strand.ropes.knots import Knot, tied
from strand.ropes.notebook import chain_html
from strand.ropes.shape import ShapeError, compare_shapes
from strand.support.checks import (
    Array,
    check_bool,
    check_finite_array,
    check_fraction_or_nan,
    check_instances,
    check_integer,
    check_nonnegative,
    check_radius,
    check_small_array,
    freeze_array,
    to_array,
)
from strand.support.lazy import lazy_property

# products of lengths stay finite
_FARTHEST = 1e75
_MOST_NODES = 1_000_000


@dataclass(frozen=True, eq=False)
class Chain:
    """One rope: its centreline as ordered nodes, end to end. Its arrays are read-only.

    Parameters
    ----------
    points : (M, 3) array_like of float
        Nodes in the world frame, metres, M >= 2, no two in a row equal.
    radius : float
        The rope's radius, metres. The default method fits it to the points, even if it was given: a given
        radius counts as known to 0.3 %, as measured by a calliper.
    closed : bool
        Whether the last node joins the first, as in a ring.
    curve : Curve, optional
        The smooth curve that the nodes are places of: `at`, `tangents` and, without covariance, `curvature`
        then come from it.
    covariance : (M, 3, 3) ndarray, optional
        Covariance of each node, m^2. With it bends are those over a window: see `curvature_vector`.
    points_seen, views_seen : (M,) ndarray of int, optional
        How many points support each node, from how many views; 0 where the curve only bridges a gap.
    radius_sd : float
        The radius's standard deviation, metres; 0 if none is known.
    confidence : float
        How likely it is that this rope runs as the chain says, from 0 to 1; NaN if the method does not say.
    doubts : tuple of Doubt
        Those of the model's doubts that are about this chain, the greatest first.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If an array has a wrong shape or is not finite, `points` has fewer than two nodes or equal
        neighbours or coordinates above 1e75 m, `radius` is not positive, `radius_sd` is negative, or
        `confidence` is not from 0 to 1.
    """

    points: Array
    radius: float
    closed: bool = False
    curve: Curve | None = None
    covariance: Array | None = None
    points_seen: NDArray[np.int64] | None = None
    views_seen: NDArray[np.int64] | None = None
    radius_sd: float = 0.0
    confidence: float = float("nan")
    doubts: tuple[Doubt, ...] = ()

    def __post_init__(self) -> None:
        points = check_finite_array("points", self.points, ("N", 3))
        if len(points) < 2:
            raise ValueError(f"points: expected at least two nodes, got {len(points)}")
        if np.abs(points).max() > _FARTHEST:
            raise ValueError(f"points: expected coordinates up to {_FARTHEST:g} m")
        object.__setattr__(self, "points", freeze_array(points))
        object.__setattr__(self, "radius", check_radius(self.radius))
        object.__setattr__(self, "closed", check_bool("closed", self.closed))
        object.__setattr__(self, "radius_sd", check_nonnegative("radius_sd", self.radius_sd))
        object.__setattr__(self, "confidence", check_fraction_or_nan("confidence", self.confidence))
        object.__setattr__(self, "doubts", check_instances("doubts", self.doubts, Doubt))
        if self.curve is not None and not isinstance(self.curve, Curve):
            raise TypeError(f"curve: expected a Curve, got {self.curve!r}")
        count = len(points)
        for name, shape in (
            ("covariance", (count, 3, 3)),
            ("points_seen", (count,)),
            ("views_seen", (count,)),
        ):
            value = getattr(self, name)
            if value is None:
                continue
            array = to_array(name, value)
            if array.dtype.kind not in ("f" if name == "covariance" else "iu"):
                raise TypeError(f"{name}: expected numbers of its kind, got dtype {array.dtype}")
            if array.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"{name}: expected finite numbers, got NaN or infinity")
            if name != "covariance" and (array < 0).any():
                raise ValueError(f"{name}: expected counts, got negative numbers")
            object.__setattr__(self, name, freeze_array(array))
        if (np.diff(self._knots) <= 0).any():
            raise ValueError("points: expected no two equal nodes in a row")

    def __repr__(self) -> str:
        return (
            f"Chain({self.length * 1e3:.1f} mm, radius {self.radius * 1e3:.2f} mm, "
            f"{'closed' if self.closed else 'open'}, {len(self.points)} nodes)"
        )

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the chain in a small plot, and its numbers."""
        return chain_html(self)

    @lazy_property
    def _path(self) -> Array:
        """The nodes, with the first one again at the end of a closed chain."""
        return np.vstack([self.points, self.points[:1]]) if self.closed else self.points

    @lazy_property
    def _knots(self) -> Array:
        """Arc length at every node of the path."""
        steps = np.linalg.norm(np.diff(self._path, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @property
    def length(self) -> float:
        """Arc length from end to end (once around, if closed), metres."""
        return float(self._knots[-1]) if self.curve is None else self.curve.length

    @property
    def bridged(self) -> NDArray[np.bool_]:
        """(M,) Whether a node only bridges a gap: it lies in a radius or more of rope without a point.

        All False if `points_seen` is not known.
        """
        bare = np.zeros(len(self.points), dtype=bool)
        if self.points_seen is not None:
            spacing = self.length / len(self.points)
            for start, stop in runs(self.points_seen == 0):
                bare[start:stop] = (stop - start) * spacing >= self.radius
        return bare

    @lazy_property
    def arc_length(self) -> Array:
        """(M,) Arc length from the first node to each node, metres."""
        if self.curve is not None:
            return np.linspace(0.0, self.curve.length, len(self.points))
        return self._knots[: len(self.points)]

    @lazy_property
    def tangents(self) -> Array:
        """(M, 3) Unit tangents at the nodes, along the order of the nodes, by central differences."""
        return self._derivatives()[0]

    @lazy_property
    def curvature(self) -> Array:
        """(M,) Curvature at the nodes, 1/m: the length of `curvature_vector` there.

        Without covariance and curve it is that of the second difference by arc length: the two ends of an
        open chain repeat their neighbours' value; a chain of two nodes has none.
        """
        if self.covariance is not None:
            bend = over_window(self.at, *self._window(self.arc_length))[1]
            return np.asarray(np.linalg.norm(bend, axis=1))
        return np.asarray(np.linalg.norm(self._derivatives()[1], axis=1))

    def _window(self, s: Array) -> tuple[Array, float]:
        """Return the middles of windows for places, and how far they reach: inside of an open chain."""
        reach = min(REACH * self.radius, 0.5 * self.length)
        around = self.closed and self.curve is None
        return s if around else np.clip(s, reach, self.length - reach), reach

    def _derivatives(self) -> tuple[Array, Array]:
        """Return unit tangents and curvature vectors at the nodes."""
        if self.curve is not None:
            return self.curve.at(self.arc_length)[1:]
        path = self._path
        if self.closed:
            path = np.vstack([path[-2], path])
        steps = np.diff(path, axis=0)
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        units = steps / lengths
        before, after = lengths[:-1], lengths[1:]
        # the tangent of the circle through three nodes, at the middle one
        middle = (units[:-1] * after + units[1:] * before) / (before + after)
        middle /= np.maximum(np.linalg.norm(middle, axis=1, keepdims=True), 1e-300)
        bend = 2.0 * np.diff(units, axis=0) / (before + after)
        if self.closed:
            return middle, bend
        if len(path) == 2:
            return np.repeat(units, 2, axis=0), np.zeros((2, 3))
        tangents = np.vstack([units[:1], middle, units[-1:]])
        return tangents, np.vstack([bend[:1], bend, bend[-1:]])

    def reversed(self) -> Chain:
        """Return the same chain, its nodes in the other order."""

        def turned(rows: Any) -> Any:
            return None if rows is None else rows[::-1]

        return replace(
            self,
            points=self.points[::-1],
            curve=None if self.curve is None else self.curve.reversed(),
            covariance=turned(self.covariance),
            points_seen=turned(self.points_seen),
            views_seen=turned(self.views_seen),
        )

    def knot(self, *, crossings: ArrayLike | None = None, direction: ArrayLike = (0.0, 0.0, 1.0)) -> Knot:
        """Name the knot that is tied in the rope, by the straight segments between its nodes.

        Parameters
        ----------
        crossings : (K, 3) array_like of float, optional
            How sure the order at crossings is: arc lengths along this chain, metres, and a probability
            each, as `strand.knot` takes them; an empty list for all sure. If not given they are those of
            `crossings(direction)`. A chain without covariances, as one that was made by hand, says nothing
            of its errors: its nodes then count as they are. So do those of chains of over 8,000 nodes.
        direction : (3,) array_like of float
            From where the crossings are seen: a vector from the rope to the viewer.

        Returns
        -------
        Knot
            Its core is in arc lengths of this chain, metres.

        Raises
        ------
        TypeError, ValueError
            As `strand.knot`.
        """
        arc = self._knots if self.closed else self.arc_length
        if crossings is not None or self.covariance is None:
            return tied(self.points, self.closed, arc, crossings, direction)
        own = listed_crossings([self], direction, self.doubts)
        rows = [(one.over[1], one.under[1], one.probability) for one in own]
        return tied(self.points, self.closed, arc, rows, direction, strict=False)

    def tube(self, sides: int = 16) -> tuple[Array, NDArray[np.int32]]:
        """Return the rope's surface as a closed triangle mesh.

        There is a ring of vertices around each node, across the centreline and a radius from it; rings are
        turned against each other as little as they can be. An open chain has flat ends.

        Parameters
        ----------
        sides : int
            How many vertices a ring has, from 3 to 1000. They are on the rope's surface, so that the tube is
            within it: its volume is n / (2 pi) sin(2 pi / n) of the rope's, 0.974 for 16.

        Returns
        -------
        vertices : (K, 3) ndarray
            World frame, metres.
        triangles : (T, 3) ndarray of int32
            Numbers of vertices, anticlockwise as seen from outside. Each edge belongs to two triangles. Where
            the rope bends more closely than its radius, they cut each other.

        Raises
        ------
        TypeError
            If `sides` is not a whole number.
        ValueError
            If it is out of range, or a closed chain has fewer than three nodes.
        """
        return tube_mesh(
            self.points, self.tangents, self.radius, self.closed, check_integer("sides", sides, 3, 1000)
        )

    def at(self, s: ArrayLike) -> Array:
        """Position at arc length `s`.

        Parameters
        ----------
        s : float or (...,) array_like
            Arc length from the first node, metres; outside [0, length] it is held at the ends of an
            open chain and goes round a closed one.

        Returns
        -------
        (..., 3) ndarray
            Places of `curve`, or on the straight segments between nodes without one, metres.

        Raises
        ------
        TypeError
            If `s` does not hold real numbers.
        ValueError
            If `s` is not finite.
        """
        at = self._held(s)
        if self.curve is not None:
            return self.curve.at(at.ravel())[0].reshape(*at.shape, 3)
        return np.stack([np.interp(at, self._knots, self._path[:, k]) for k in range(3)], axis=-1)

    def tangent_at(self, s: ArrayLike) -> Array:
        """Direction of the rope at arc length `s`.

        Parameters
        ----------
        s : float or (...,) array_like
            As for `at`.

        Returns
        -------
        (..., 3) ndarray
            Unit tangents, of `curve`; without one between the nodes' `tangents`.

        Raises
        ------
        TypeError, ValueError
            As `at`.
        """
        at = self._held(s)
        if self.curve is not None:
            return self.curve.at(at.ravel())[1].reshape(*at.shape, 3)
        mixed = self._mixed(self._directions, at)
        lengths = np.linalg.norm(mixed, axis=-1, keepdims=True)
        # halfway round a strand that turns back on itself there is none: that before it
        lost = (lengths < 1e-9)[..., 0]
        mixed[lost] = self._directions[np.searchsorted(self._knots, at[lost], side="right") - 1]
        lengths[lost] = 1.0
        return np.asarray(mixed / lengths)

    def interpolated(self, values: ArrayLike, s: ArrayLike) -> Array:
        """Values that are known at the nodes, such as `covariance`, at arc length `s`: linear between nodes.

        Parameters
        ----------
        values : (M, ...) array_like of float
            One for each node.
        s : float or (...,) array_like
            As for `at`.

        Returns
        -------
        ndarray
            Of the shape of `s`, and then that of one value.

        Raises
        ------
        TypeError
            If `s` or `values` do not hold real numbers.
        ValueError
            If there is not one value for each node, or `s` is not finite.
        """
        given = to_array("values", values)
        if given.dtype.kind not in "fiu":
            raise TypeError(f"values: expected real numbers, got dtype {given.dtype}")
        if not given.ndim or len(given) != len(self.points):
            raise ValueError(f"values: expected one for each of {len(self.points)} nodes, got {given.shape}")
        return self._mixed(given.astype(np.float64), self._held(s))

    def _held(self, s: ArrayLike) -> Array:
        """Arc lengths on the chain: of an open one held at its ends, of a closed one round it."""
        given = to_array("s", s)
        if given.dtype.kind not in "fiu":
            raise TypeError(f"s: expected arc lengths in metres, got dtype {given.dtype}")
        at = given.astype(np.float64)
        if not np.isfinite(at).all():
            raise ValueError("s: expected finite arc lengths, got NaN or infinity")
        if self.closed and self.curve is None:
            return np.asarray(np.mod(at, self.length))
        return np.asarray(np.clip(at, 0.0, self.length))

    def _mixed(self, values: Array, s: Array) -> Array:
        """Values of the nodes at arc lengths on the chain."""
        known = self.arc_length
        if self.closed and self.curve is None:
            known, values = self._knots, np.concatenate([values, values[:1]])
        return between(s, known, values)

    @lazy_property
    def _directions(self) -> Array:
        """(M, 3) Unit tangents at the nodes, also where the nodes turn back on themselves."""
        lost = np.linalg.norm(self.tangents, axis=1) < 0.5
        if not lost.any():
            return self.tangents
        steps = np.diff(self._path, axis=0)
        steps /= np.linalg.norm(steps, axis=1, keepdims=True)
        before = np.roll(steps, 1, axis=0) if self.closed else np.vstack([steps[:1], steps])
        return np.where(lost[:, None], before, self.tangents)

    def frames(self, s: ArrayLike) -> tuple[Array, Array]:
        """Positions and twist-free frames at arc length `s`, for what follows the rope.

        The frames are Bishop's: they do not turn about the tangent along the rope, at inflections neither.
        They are carried from node to node by double reflection (Wang et al. 2008).

        Parameters
        ----------
        s : float or (...,) array_like
            As for `at`.

        Returns
        -------
        positions : (..., 3) ndarray
            World frame, metres: `at(s)`.
        rotations : (..., 3, 3) ndarray
            From the frame to the world. The columns are x, along the tangent; y, across it; and z = x × y. At
            the start z is as near to the world's z as it can be, or, where the rope starts along that, to the
            world's x. Once around a closed chain the frame comes back turned about x.

        Raises
        ------
        TypeError, ValueError
            As `at`.
        """
        at = self._held(s)
        flat = at.ravel()
        place, tangent = self.at(flat), self.tangent_at(flat)
        node = np.clip(np.searchsorted(self.arc_length, flat, side="right") - 1, 0, len(self.points) - 1)
        side = carried(self._across[node], self.points[node], self._directions[node], place, tangent)
        rotation = np.stack([tangent, np.cross(side, tangent), side], axis=-1)
        return place.reshape(*at.shape, 3), rotation.reshape(*at.shape, 3, 3)

    @lazy_property
    def _across(self) -> Array:
        """(M, 3) The z axes of the frames at the nodes."""
        return node_frames(self.points, self._directions, least_turned(self._directions[0]))

    def curvature_vector(self, s: ArrayLike) -> Array:
        """Curvature vector at arc length `s`: to where the rope bends, and how much.

        Parameters
        ----------
        s : float or (...,) array_like
            As for `at`.

        Returns
        -------
        (..., 3) ndarray
            The tangent's derivative by arc length, 1/m. If the chain has covariances it is that of the
            quintic that fits best to four radii of rope on either side: nodes of a reconstruction have
            errors, above all where a ring's ends meet and at open ends, which are no bends of the rope.
            Within four radii of an open end it is as four radii from it. Without covariances it is that of
            `curve`, or between the nodes' values.

        Raises
        ------
        TypeError, ValueError
            As `at`.
        """
        at = self._held(s)
        if self.covariance is not None:
            return over_window(self.at, *self._window(at.ravel()))[1].reshape(*at.shape, 3)
        if self.curve is not None:
            return self.curve.at(at.ravel())[2].reshape(*at.shape, 3)
        return self._mixed(self._derivatives()[1], at)

    def torsion(self, s: ArrayLike) -> Array:
        """Torsion at arc length `s`: how fast the plane in which the rope bends turns about the tangent.

        Parameters
        ----------
        s : float or (...,) array_like
            As for `at`.

        Returns
        -------
        (...,) ndarray
            1/m, positive as of a right-handed helix; 0 where the rope is straight. It is
            det(c', c'', c''') / |c' × c''|^2: if the chain has covariances, of the quintics of
            `curvature_vector`, else of `curve`, where it steps at the ends of the pieces. Without either it
            is the angle between the planes of three nodes each, over the length of the step that they share,
            and linear between the steps' middles. Where a reconstructed rope hardly bends it is noise.

        Raises
        ------
        TypeError, ValueError
            As `at`.
        """
        at = self._held(s)
        if self.covariance is not None:
            return torsion_over_window(self.at, *self._window(at.ravel())).reshape(at.shape)
        if self.curve is not None:
            return torsion_of_curve(self.curve, at)
        return torsion_of_nodes(self.points, self.closed, at)

    def min_bend_radius(self) -> tuple[float, float]:
        """Where the rope bends most closely.

        Returns
        -------
        radius : float
            One over the curvature there, as `curvature_vector` has it, metres; infinite if the rope is
            straight.
        s : float
            Arc length of that place, metres, the first of several; 0 if the rope is straight. With
            covariances, or without `curve`, it is a node.
        """
        if self.curve is not None and self.covariance is None:
            return least_bend(self.curve, self.arc_length)
        worst = int(self.curvature.argmax())
        bend = float(self.curvature[worst])
        if bend * self.length <= STRAIGHT:
            return float("inf"), 0.0
        return 1.0 / bend, float(self.arc_length[worst])

    def resample(self, n: int) -> Chain:
        """Return the same rope with `n` nodes, evenly apart along it.

        Parameters
        ----------
        n : int
            At least 2, of a closed chain 3; at most 1,000,000.

        Returns
        -------
        Chain
            With nodes at `at(s)`. Covariances are linear between the nodes there were, `points_seen` and
            `views_seen` those of the nearest one. Without `curve` the new nodes' straight segments cut
            corners: the chain is shorter then.

        Raises
        ------
        TypeError
            If `n` is not a whole number.
        ValueError
            If it is out of range.
        """
        count = check_integer("n", n, 3 if self.closed else 2, _MOST_NODES)
        s = np.linspace(0.0, self.length, count, endpoint=not (self.closed and self.curve is None))
        nearest = np.rint(self._mixed(np.arange(len(self.points), dtype=np.float64), s)).astype(np.intp)
        if self.closed:
            # between the last node and the first one numbers do not go on
            last = s > self.arc_length[-1]
            nearest[last] = np.where(
                s[last] - self.arc_length[-1] < self.length - s[last], len(self.points) - 1, 0
            )
        return replace(
            self,
            points=self.at(s),
            covariance=None if self.covariance is None else self._mixed(self.covariance, s),
            points_seen=None if self.points_seen is None else self.points_seen[nearest],
            views_seen=None if self.views_seen is None else self.views_seen[nearest],
        )

    def crossings(self, direction: ArrayLike = (0, 0, 1)) -> tuple[Crossing, ...]:
        """Find where the rope crosses itself as seen from one side, see `Model.crossings`.

        Parameters
        ----------
        direction : (3,) array_like
            Towards who looks, world frame, of any length but zero.

        Returns
        -------
        tuple of Crossing
            Along the chain, whose number is 0 here.

        Raises
        ------
        TypeError
            If `direction` does not hold real numbers.
        ValueError
            If it is not of shape (3,), not finite, or zero.
        """
        return find_crossings([self], direction, self.doubts)

    def shape_error(self, target: Chain | ArrayLike) -> ShapeError:
        """Compare the rope with the shape that it should have.

        Places at equal shares of both lengths belong to each other: from the end that fits better, of a ring
        from the start that fits best, either way round. Nothing is moved or turned to fit.

        Parameters
        ----------
        target : Chain or (N, 3) array_like
            The shape, or its nodes in order, N >= 2, world frame, metres; closed if the chain is.

        Returns
        -------
        ShapeError

        Raises
        ------
        TypeError
            If `target` is neither.
        ValueError
            If it has a wrong shape, equal neighbours or NaN, or only one of the two is closed.
        """
        if not isinstance(target, Chain):
            nodes = check_finite_array("target", target, ("N", 3))
            if len(nodes) < 2 or not np.diff(nodes, axis=0).any(axis=1).all():
                raise ValueError("target: expected at least two nodes, no two equal in a row")
            target = Chain(nodes, self.radius, self.closed)
        if target.closed != self.closed:
            wanted, got = ("closed", "open") if self.closed else ("open", "closed")
            raise ValueError(f"target: expected one that is {wanted}, as the chain, got one that is {got}")
        return compare_shapes(self, target)

    def nearest(self, p: ArrayLike) -> tuple[float, float]:
        """Closest place of the centreline to a point.

        Parameters
        ----------
        p : (3,) array_like
            A point in the world frame, metres.

        Returns
        -------
        s : float
            Arc length of the closest place, metres.
        distance : float
            Its distance from `p`, metres.

        Raises
        ------
        TypeError
            If `p` does not hold real numbers.
        ValueError
            If `p` is not of shape (3,) or not finite.
        """
        point = check_small_array("p", p, (3,))
        start, step = self._path[:-1], np.diff(self._path, axis=0)
        t = np.clip(((point - start) * step).sum(axis=1) / (step * step).sum(axis=1), 0.0, 1.0)
        distance = np.linalg.norm(start + t[:, None] * step - point, axis=1)
        i = int(distance.argmin())
        if self.curve is not None:
            return self._nearest_on_curve(self.curve, point, float(self.arc_length[i] + t[i] * self._spacing))
        return float(self._knots[i] + t[i] * (self._knots[i + 1] - self._knots[i])), float(distance[i])

    def signed_distance(self, points: ArrayLike) -> Array:
        """Distance of points from the rope's surface, negative inside.

        The surface is that of all balls of the radius around the straight segments between nodes, and around
        the ends: the distance from the axis minus the radius. Outside it is exact. Inside it is at most the
        way out: where the rope touches itself or bends closely the surface of the other strand is farther.
        `Model.signed_distance` asks all chains.

        Parameters
        ----------
        points : (N, 3) array_like of float
            World frame, metres.

        Returns
        -------
        (N,) ndarray
            Metres.

        Raises
        ------
        TypeError
            If `points` does not hold floating point numbers.
        ValueError
            If its shape is wrong, or a coordinate is not finite.
        """
        return self._tube.signed_distances(points)

    @lazy_property
    def _tube(self) -> TubeQueries:
        return tube_queries([self])

    def _arcs(self) -> tuple[Array, Array]:
        """Return the nodes of the path, and the arc length at each, as in `at`."""
        if self.curve is None:
            return self._path, self._knots
        # the last step of a closed chain is not one of the curve's
        closing = np.diff(self._knots[-2:]) if self.closed else np.empty(0)
        return self._path, np.append(self.arc_length, self.length + closing)

    @property
    def _spacing(self) -> float:
        """Arc length between the nodes of a smooth curve."""
        return self.length / (len(self.points) - 1)

    @staticmethod
    def _nearest_on_curve(curve: Curve, point: Array, s: float) -> tuple[float, float]:
        """Refine the arc length of the closest place by Newton's method."""
        for _ in range(4):
            position, tangent, bend = (rows[0] for rows in curve.at([s]))
            offset = point - position
            slope = max(1.0 - float(offset @ bend), 0.1)
            s = float(np.clip(s + offset @ tangent / slope, 0.0, curve.length))
        return s, float(np.linalg.norm(point - curve.at([s])[0][0]))


def tube_queries(chains: Sequence[Chain]) -> TubeQueries:
    """Return what answers queries against the tubes of chains."""
    paths = [chain._arcs() for chain in chains]
    radii = [chain.radius for chain in chains]
    return TubeQueries([nodes for nodes, _ in paths], [arcs for _, arcs in paths], radii)
