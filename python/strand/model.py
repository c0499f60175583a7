"""What a reconstruction returns: chains of nodes, and the model that holds them."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand import io
from strand.arguments import as_array, flag, not_negative, number, several, text, whole
from strand.curve import Curve
from strand.memo import memo
from strand.nextview import best_camera
from strand.topology import runs
from strand.view import Array, checked_radius, finite_array, float_array


@dataclass(frozen=True, eq=False)
class Chain:
    """One string: its centreline as ordered nodes, end to end.

    Parameters
    ----------
    points : (M, 3) array_like of float
        Nodes in the world frame, metres, M >= 2, no two in a row equal.
    radius : float
        The string's radius, metres. The default method's is what the points say of it, also if it was given:
        that counts as known to 0.3 %, as by a calliper.
    closed : bool
        Whether the last node joins the first, as in a ring.
    curve : Curve, optional
        The smooth curve that the nodes are places of: `at`, `tangents` and `curvature` then come from it.
    covariance : (M, 3, 3) ndarray, optional
        Covariance of each node, m^2.
    points_seen, views_seen : (M,) ndarray of int, optional
        How many points support each node, from how many views; 0 where the curve only bridges a gap.
    radius_sd : float
        The radius's standard deviation, metres; 0 if none is known.

    Raises
    ------
    TypeError
        If an argument is of the wrong kind.
    ValueError
        If an array has a wrong shape or is not finite, `points` has fewer than two nodes or equal
        neighbours, `radius` is not positive, or `radius_sd` is negative.
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
        points = finite_array("points", self.points, (None, 3))
        if len(points) < 2:
            raise ValueError(f"points: expected at least two nodes, got {len(points)}")
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "radius", checked_radius(self.radius))
        object.__setattr__(self, "closed", flag("closed", self.closed))
        object.__setattr__(self, "radius_sd", not_negative("radius_sd", self.radius_sd))
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
            array = as_array(name, value)
            if array.dtype.kind not in ("f" if name == "covariance" else "iu"):
                raise TypeError(f"{name}: expected numbers of its kind, got dtype {array.dtype}")
            if array.shape != shape:
                raise ValueError(f"{name}: expected shape {shape}, got {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"{name}: expected finite numbers, got NaN or infinity")
        if (np.diff(self._knots) <= 0).any():
            raise ValueError("points: expected no two equal nodes in a row")

    @memo
    def _path(self) -> Array:
        """The nodes, with the first one again at the end of a closed chain."""
        return np.vstack([self.points, self.points[:1]]) if self.closed else self.points

    @memo
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
        """(M,) Whether a node only bridges a gap: it lies in a radius or more of string without a point.

        All False if `points_seen` is not known.
        """
        bare = np.zeros(len(self.points), dtype=bool)
        if self.points_seen is not None:
            spacing = self.length / len(self.points)
            for start, stop in runs(self.points_seen == 0):
                bare[start:stop] = (stop - start) * spacing >= self.radius
        return bare

    @property
    def arc_length(self) -> Array:
        """(M,) Arc length from the first node to each node, metres."""
        if self.curve is not None:
            return np.linspace(0.0, self.curve.length, len(self.points))
        return self._knots[: len(self.points)]

    @memo
    def tangents(self) -> Array:
        """(M, 3) Unit tangents at the nodes, along the order of the nodes, by central differences."""
        return self._derivatives()[0]

    @memo
    def curvature(self) -> Array:
        """(M,) Curvature at the nodes, 1/m: the length of the second difference by arc length.

        The two ends of an open chain repeat their neighbours' value; a chain of two nodes has none.
        """
        return np.asarray(np.linalg.norm(self._derivatives()[1], axis=1))

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
        ValueError
            If `s` is not finite.
        """
        at = np.asarray(s, dtype=np.float64)
        if not np.isfinite(at).all():
            raise ValueError("s: expected finite arc lengths, got NaN or infinity")
        if self.curve is not None:
            return self.curve.at(at.ravel())[0].reshape(*at.shape, 3)
        if self.closed:
            at = np.mod(at, self.length)
        return np.stack([np.interp(at, self._knots, self._path[:, k]) for k in range(3)], axis=-1)

    def nearest(self, p: ArrayLike) -> tuple[float, float]:
        """Closest place of the centreline to a point.

        Parameters
        ----------
        p : (3,) array_like of float
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
            If `p` does not hold floating point numbers.
        ValueError
            If `p` is not of shape (3,) or not finite.
        """
        point = finite_array("p", p, (3,))
        start, step = self._path[:-1], np.diff(self._path, axis=0)
        t = np.clip(((point - start) * step).sum(axis=1) / (step * step).sum(axis=1), 0.0, 1.0)
        distance = np.linalg.norm(start + t[:, None] * step - point, axis=1)
        i = int(distance.argmin())
        if self.curve is not None:
            return self._nearest_on_curve(self.curve, point, float(self.arc_length[i] + t[i] * self._spacing))
        return float(self._knots[i] + t[i] * (self._knots[i + 1] - self._knots[i])), float(distance[i])

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


@dataclass(frozen=True, eq=False)
class Join:
    """A place where pieces that were seen were joined to one string.

    Attributes
    ----------
    place : (3,) ndarray
        The middle of the gap, world frame, metres.
    chains : tuple of int
        Numbers of the chains that run there.
    margin : float
        How much dearer the next best way to join the pieces is, in the units of `Config.linking`'s costs,
        where a free end costs 5. Near 0: as good.
    alternative : (3,) ndarray or None
        Where the string would go on instead, metres; None: it would end.
    """

    place: Array
    chains: tuple[int, ...]
    margin: float
    alternative: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", finite_array("place", self.place, (3,)))
        numbers = several("chains", self.chains, "whole numbers")
        object.__setattr__(self, "chains", tuple(whole("chains", chain) for chain in numbers))
        object.__setattr__(self, "margin", number("margin", self.margin))
        if self.alternative is not None:
            object.__setattr__(self, "alternative", finite_array("alternative", self.alternative, (3,)))


@dataclass(frozen=True, eq=False)
class Doubt:
    """What speaks against an answer.

    Attributes
    ----------
    amount : float
        The confidence is exp(-0.01 - d), where d adds up all doubts' amounts; 0 or above.
    about : str
        What is uncertain.
    reason : str
        Why.
    place : (3,) ndarray or None
        Where, world frame, metres; None if it is about the strings as a whole.
    """

    amount: float
    about: str
    reason: str
    place: Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "amount", not_negative("amount", self.amount))
        object.__setattr__(self, "about", text("about", self.about))
        object.__setattr__(self, "reason", text("reason", self.reason))
        if self.place is not None:
            object.__setattr__(self, "place", finite_array("place", self.place, (3,)))

    def __str__(self) -> str:
        where = "" if self.place is None else f" at {np.round(self.place, 3).tolist()}"
        return f"unsure {self.about}{where}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another way to make strings of the pieces that were seen.

    Attributes
    ----------
    cost : float
        How much dearer it is than the answer, in radii of string that it leaves unexplained more.
    chains : tuple of (K, 3) ndarray
        Nodes of each string in order, world frame, metres, before the last fit.
    """

    cost: float
    chains: tuple[Array, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "cost", number("cost", self.cost))
        each = several("chains", self.chains, "arrays")
        nodes = tuple(finite_array(f"chains[{i}]", one, (None, 3)) for i, one in enumerate(each))
        object.__setattr__(self, "chains", nodes)


@dataclass(frozen=True, eq=False)
class Model:
    """A point chain model: the strings that the views show.

    Attributes
    ----------
    chains : tuple of Chain
        The strings, longest first.
    poses : (V, 4, 4) ndarray
        Camera-to-world poses after registration, one for each view that was given.
    timings : dict of str to float
        Seconds that each stage took, in the stages' order.
    warnings : tuple of str
        What the caller should know about the data: views that saw nothing, for example.
    stages : dict of str to object
        The arrays between the stages, if they were asked for (see `strand.reconstruct`); else empty.
    pose_sd : (V, 6) ndarray
        Standard deviations of the poses' corrections in the world frame: rotation vector, radians, and
        translation of the points' centroid, metres; 0 for the view that stayed, NaN where none is known.
    confidence : float
        How likely it is that the strings run as the chains say, from 0 to 1: in order, none missing, none
        joined to another, ends in place. NaN if the method does not say.
    joins : tuple of Join
        Where pieces were joined over gaps and crossings, the least certain first.
    doubts : tuple of Doubt
        What speaks against the answer and lowers `confidence`, the greatest first.
    alternatives : tuple of Alternative
        Other ways to make strings of the pieces that were fitted too, the best first; of each kind of rope,
        if there are several.
    """

    chains: tuple[Chain, ...]
    poses: Array
    timings: dict[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    stages: dict[str, Any] = field(default_factory=dict, repr=False)
    pose_sd: Array = field(default_factory=lambda: np.empty((0, 6)))
    confidence: float = float("nan")
    joins: tuple[Join, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    alternatives: tuple[Alternative, ...] = ()

    def __post_init__(self) -> None:
        for name, kind in (
            ("chains", Chain),
            ("warnings", str),
            ("joins", Join),
            ("doubts", Doubt),
            ("alternatives", Alternative),
        ):
            held = several(name, getattr(self, name), kind.__name__)
            for i, one in enumerate(held):
                if not isinstance(one, kind):
                    raise TypeError(f"{name}[{i}]: expected type {kind.__name__}, got {type(one).__name__}")
            object.__setattr__(self, name, held)
        for name in ("timings", "stages"):
            if not isinstance(getattr(self, name), dict):
                raise TypeError(f"{name}: expected a dict, got {type(getattr(self, name)).__name__}")
        object.__setattr__(self, "poses", float_array("poses", self.poses, (None, 4, 4)))
        object.__setattr__(self, "pose_sd", float_array("pose_sd", self.pose_sd, (None, 6)))
        known = not isinstance(self.confidence, float) or not np.isnan(self.confidence)
        if known and not 0.0 <= number("confidence", self.confidence) <= 1.0:
            raise ValueError(f"confidence: expected a number from 0 to 1, or NaN, got {self.confidence}")

    def next_view(self) -> Array:
        """Camera position from which one more view would tell most: it best sees the least certain place.

        That is the place of the greatest doubt; without any that has one, of the join with the least margin;
        without joins, the place that fewest points support.

        Returns
        -------
        (3,) ndarray
            World frame, metres; as far from the place as the cameras were, in the median.

        Raises
        ------
        ValueError
            If there is no chain, or no pose whose camera is away from the place.
        """
        if not self.chains or not len(self.poses):
            raise ValueError("model: expected chains and poses, got none")
        places = [doubt.place for doubt in self.doubts if doubt.place is not None]
        places += [join.place for join in self.joins]
        if places:
            place = places[0]
        else:
            weakest = [
                (int(chain.points_seen.min()), k)
                for k, chain in enumerate(self.chains)
                if chain.points_seen is not None
            ]
            chain = self.chains[min(weakest)[1]] if weakest else self.chains[0]
            seen = chain.points_seen
            place = chain.points[len(chain.points) // 2 if seen is None else int(seen.argmin())]
        radius = self.chains[0].radius
        return best_camera(place, [chain.points for chain in self.chains], self.poses[:, :3, 3], radius)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write all but the arrays between the stages to a JSON file, whole or not at all.

        Parameters
        ----------
        path : str or path-like
            The file; one that exists is replaced.

        Raises
        ------
        OSError
            If the file cannot be written.
        """
        io.write_json(
            path,
            {
                "format": "strand model",
                "version": 1,
                "units": "metres, radians, seconds",
                "chains": [_chain_data(chain) for chain in self.chains],
                "poses": self.poses.tolist(),
                "pose_sd": [None if np.isnan(sd).any() else sd.tolist() for sd in self.pose_sd],
                "timings": self.timings,
                "warnings": list(self.warnings),
                "confidence": None if np.isnan(self.confidence) else self.confidence,
                "joins": [
                    {
                        "place": join.place.tolist(),
                        "chains": list(join.chains),
                        "margin": join.margin,
                        "alternative": None if join.alternative is None else join.alternative.tolist(),
                    }
                    for join in self.joins
                ],
                "doubts": [
                    {
                        "amount": doubt.amount,
                        "about": doubt.about,
                        "reason": doubt.reason,
                        "place": None if doubt.place is None else doubt.place.tolist(),
                    }
                    for doubt in self.doubts
                ],
                "alternatives": [
                    {"cost": other.cost, "chains": [nodes.tolist() for nodes in other.chains]}
                    for other in self.alternatives
                ],
            },
        )


def _chain_data(chain: Chain) -> dict[str, Any]:
    """Everything that a chain holds, in JSON's types."""
    data: dict[str, Any] = {
        "points": chain.points.tolist(),
        "radius": chain.radius,
        "radius_sd": chain.radius_sd,
        "closed": chain.closed,
    }
    if chain.curve is not None:
        curve = chain.curve
        data["curve"] = {"control": curve.control.tolist(), "start": curve.start, "stop": curve.stop}
    for name in ("covariance", "points_seen", "views_seen"):
        value = getattr(chain, name)
        if value is not None:
            data[name] = value.tolist()
    return data


def _chain(data: dict[str, Any]) -> Chain:
    """Make a chain of what `_chain_data` gave."""
    curve = data.get("curve")
    kinds = {"covariance": float, "points_seen": int, "views_seen": int}
    arrays: dict[str, NDArray[Any] | None] = {
        name: np.asarray(data[name], kind) if name in data else None for name, kind in kinds.items()
    }
    return Chain(
        np.asarray(data["points"], dtype=np.float64),
        data["radius"],
        bool(data["closed"]),
        None if curve is None else Curve(np.asarray(curve["control"], float), curve["start"], curve["stop"]),
        arrays["covariance"],
        arrays["points_seen"],
        arrays["views_seen"],
        data["radius_sd"],
    )


def _join(data: dict[str, Any]) -> Join:
    """Make a join of what `Model.save` wrote."""
    other = data["alternative"]
    return Join(
        np.asarray(data["place"], dtype=np.float64),
        tuple(int(number) for number in data["chains"]),
        float(data["margin"]),
        None if other is None else np.asarray(other, dtype=np.float64),
    )


def _doubt(data: dict[str, Any]) -> Doubt:
    """Make a doubt of what `Model.save` wrote."""
    place = None if data["place"] is None else np.asarray(data["place"], dtype=np.float64)
    return Doubt(data["amount"], data["about"], data["reason"], place)


def _alternative(data: dict[str, Any]) -> Alternative:
    """Make an alternative of what `Model.save` wrote."""
    chains = tuple(np.asarray(nodes, dtype=np.float64).reshape(-1, 3) for nodes in data["chains"])
    return Alternative(data["cost"], chains)


def load(path: str | os.PathLike[str]) -> Model:
    """Read a model that `Model.save` wrote.

    Parameters
    ----------
    path : str or path-like
        The JSON file.

    Returns
    -------
    Model
        With the same chains, poses, deviations, timings, warnings, confidence, joins, doubts and
        alternatives, bit for bit; without stages.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If the file is truncated or is not a model.
    """
    data = io.read_json(path)
    if not isinstance(data, dict) or data.get("format") != "strand model":
        raise io.FileFormatError(f"{path}: not a strand model")
    if data.get("version") != 1:
        raise io.FileFormatError(f"{path}: model version {data.get('version')!r}, this reads version 1")
    try:
        chains = tuple(_chain(chain) for chain in data["chains"])
        poses = np.asarray(data["poses"], dtype=np.float64).reshape(-1, 4, 4)
        pose_sd = np.array([[np.nan] * 6 if sd is None else sd for sd in data["pose_sd"]], dtype=np.float64)
        confidence = data.get("confidence")
        return Model(
            chains,
            poses,
            dict(data["timings"]),
            tuple(data["warnings"]),
            {},
            pose_sd.reshape(-1, 6),
            float("nan") if confidence is None else float(confidence),
            tuple(_join(join) for join in data.get("joins", [])),
            tuple(_doubt(doubt) for doubt in data.get("doubts", [])),
            tuple(_alternative(other) for other in data.get("alternatives", [])),
        )
    except (AttributeError, KeyError, OverflowError, TypeError, ValueError) as error:
        raise io.FileFormatError(f"{path}: not a strand model ({error})") from error
