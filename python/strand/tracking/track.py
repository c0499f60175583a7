"""The answer of a tracker: ropes with their motion, and what happened to them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from strand.geometry.plane import Plane
from strand.ropes.chain import Chain
from strand.ropes.doubt import ModelWarning
from strand.ropes.model import Model
from strand.support.checks import Array, freeze_array
from strand.support.lazy import lazy_property
from strand.tracking.events import Event
from strand.tracking.rope_state import RopeState

if TYPE_CHECKING:
    from typing_extensions import Self

_SPLINES = 64  # numbers of nodes whose weights are kept
_SAMPLES = 4  # nodes of the answer for each of the tracker's
_LEAST_SD = 0.04  # radii
_DEVIATIONS = 2.3  # times the deviation of the fit: neighbouring pixels share errors
_HIDDEN_DEVIATIONS = 4.2  # likewise, of hidden nodes: their motion from frame to frame is alike
_ALONG_SD = 0.15  # radii: along the rope, where a tip is seen
_ALONG_HIDDEN = 0.8  # radii: along the rope, where none is
_ALONG_LENGTH = 0.25  # of the length's deviation: by which end arc lengths are off
_MIN_WARNED = 0.1  # lesser doubts have no warning
_AHEAD_SPEED = 0.5  # of the fastest speed, by the time ahead


@dataclass(frozen=True, eq=False, repr=False)
class TrackedRope(Chain):
    """A rope at a time. It is a `Chain`, so crossings, queries, grasps and exports take it.

    All attributes of nodes have one entry for each of M nodes, which stay at the same places of the rope.

    Attributes
    ----------
    number : int
        The same for the same rope, whatever happens to it.
    generation : int
        It grows when another reconstruction moved a node by more than 5 radii: earlier answers were wrong.
    state : str
        "tentative" until its first shape is sure, "tracking", "coasting" while nothing of it is seen, or
        "lost".
    s : (M,) ndarray
        Arc length from the rope's first end, metres.
    velocity : (M, 3) ndarray
        World frame, metres per second.
    seen : (M,) ndarray of bool
        Whether pixels support a node. Else it is `bridged`, or hidden and therefore `predicted`.
    predicted : (M,) ndarray of bool
    age : (M,) ndarray
        Time since a node was last seen, s.
    length_sd : float
        Standard deviation of the length, metres.

    `covariance` holds the uncertainty along the rope too, which is larger than that across it.
    """

    number: int = 0
    generation: int = 0
    state: str = "tracking"
    s: Array = field(default_factory=lambda: np.empty(0))
    velocity: Array = field(default_factory=lambda: np.empty((0, 3)))
    seen: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool))
    predicted: NDArray[np.bool_] = field(default_factory=lambda: np.empty(0, dtype=bool))
    age: Array = field(default_factory=lambda: np.empty(0))
    length_sd: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("s", "velocity", "seen", "predicted", "age"):
            object.__setattr__(self, name, freeze_array(np.asarray(getattr(self, name))))

    def __repr__(self) -> str:
        return (
            f"TrackedRope({self.number}, {self.state}, {self.length * 1e3:.1f} mm, "
            f"seen {self.seen.mean():.0%}, generation {self.generation})"
        )

    @lazy_property
    def _path_arcs(self) -> Array:
        return self.s

    @property
    def bridged(self) -> NDArray[np.bool_]:
        """(M,) Whether a node is not seen but lies between nodes that are, with nothing nearer before it."""
        return ~self.seen & ~self.predicted

    def reversed(self) -> Self:
        """Return the same rope with its nodes in the other order."""
        rows = {name: getattr(self, name)[::-1] for name in ("velocity", "seen", "predicted", "age")}
        turned = replace(self, points=self.points[::-1], s=self.s[-1] - self.s[::-1], **rows)
        covariance = None if self.covariance is None else self.covariance[::-1]
        return replace(turned, covariance=covariance, hidden_ends=self.hidden_ends[::-1])


@dataclass(frozen=True, eq=False)
class Track:
    """The answer of a tracker after a frame.

    Attributes
    ----------
    ropes : tuple of TrackedRope
        In the order of their numbers; empty until a rope is found.
    events : tuple of Event
        What happened since the last answer.
    time : float
        Time of the answer, s: that of the latest image, or the one that was asked for.
    image_times : tuple of float
        Time of each camera's image, s.
    unexplained : float
        Share of the ropes' pixels that no rope explains.
    up : (3,) ndarray
        Unit vector up from the table, world frame.
    table : Plane or None
    reason : str
        Why there are no ropes, as the last reconstruction said; empty with ropes, or if none was tried.
    """

    ropes: tuple[TrackedRope, ...]
    events: tuple[Event, ...]
    time: float
    image_times: tuple[float, ...]
    unexplained: float
    up: Array
    table: Plane | None
    reason: str = ""

    @lazy_property
    def model(self) -> Model:
        """The ropes as a `Model`, for its crossings, queries, grasps, pulls, files and exports."""
        sure = [rope.confidence for rope in self.ropes]
        doubts = [(doubt, i) for i, rope in enumerate(self.ropes) for doubt in rope.doubts]
        warnings = [
            ModelWarning(doubt.kind, str(doubt), doubt.place, doubt.amount, (i,))
            for doubt, i in doubts
            if doubt.amount >= _MIN_WARNED
        ]
        return Model(
            self.ropes,
            poses=np.empty((0, 4, 4)),
            warnings=tuple(warnings),
            confidence=min(sure, default=float("nan")),
            doubts=tuple(sorted((doubt for doubt, _ in doubts), key=lambda doubt: -doubt.amount)),
            up=self.up,
            table=self.table,
            stamp=self.time,
        )

    def __repr__(self) -> str:
        lines = [f"Track({self.time:.3f} s, ropes: {len(self.ropes)}, events: {len(self.events)})"]
        lines += [f"  no rope: {self.reason}"] if self.reason else []
        return "\n".join(lines + [f"  {rope!r}" for rope in self.ropes])


def describe_rope(rope: RopeState, up: Array, ahead: float = 0.0) -> TrackedRope:
    """Return a rope's answer, `ahead` seconds after its state."""
    count = len(rope.nodes)
    at = np.linspace(0.0, count - 1.0, (count - 1) * _SAMPLES + 1)
    weights = _make_spline(count)
    nodes = rope.nodes + ahead * rope.velocities
    age = np.interp(at, np.arange(count), rope.scalars[:, 2]) + (ahead if ahead > 0 else 0.0)
    hidden = rope.hidden[np.rint(at).astype(int)]
    supported = np.interp(at, np.arange(count), rope.seen) >= 0.4
    points = weights @ nodes
    covariance = _estimate_covariance(rope, at, points, ahead)
    return TrackedRope(
        points,
        rope.radius,
        covariance=covariance,
        confidence=rope.confidence,
        doubts=rope.doubts,
        up=up,
        label=rope.label,
        hidden_ends=rope.covered_ends,
        number=rope.number,
        generation=rope.generation,
        state=rope.state,
        s=at * rope.spacing,
        velocity=weights @ rope.velocities,
        seen=supported & ~hidden,
        predicted=hidden,
        age=np.where(hidden, age, 0.0),
        length_sd=rope.length_sd,
    )


def _estimate_covariance(rope: RopeState, at: Array, points: Array, ahead: float) -> Array:
    """Return (K, 3, 3) covariances: of the fit, of the time ahead, and of places along the rope."""
    count, r = len(rope.nodes), rope.radius
    low = np.minimum(at.astype(int), count - 2)
    x = (at - low)[:, None, None]
    fitted = (1.0 - x) * rope.covariances[low] + x * rope.covariances[low + 1]
    hidden = rope.hidden[np.rint(at).astype(int)]
    times = np.where(hidden, _HIDDEN_DEVIATIONS, _DEVIATIONS)[:, None, None]
    fastest = float(np.linalg.norm(rope.velocities, axis=1).max())
    alike = (_LEAST_SD * r) ** 2 + (_AHEAD_SPEED * ahead * fastest) ** 2
    tangents = np.gradient(points, axis=0)
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-12)
    free = rope.hidden[0] and rope.hidden[-1]
    missed = 0.0 if rope.slid is None else 0.5 * abs(rope.slid)
    tip = (_ALONG_HIDDEN if free else _ALONG_SD) * r
    along = tip**2 + missed**2 + (_ALONG_LENGTH * rope.length_sd) ** 2
    return np.asarray(
        times**2 * fitted + alike * np.eye(3) + along * tangents[:, :, None] * tangents[:, None, :]
    )


@lru_cache(maxsize=_SPLINES)
def _make_spline(count: int) -> Array:
    """Return the (K, count) weights of Catmull and Rom's spline at the answer's nodes."""
    at = np.linspace(0.0, count - 1.0, (count - 1) * _SAMPLES + 1)
    span = np.minimum(at.astype(int), count - 2)
    x = at - span
    values = 0.5 * np.stack(
        [-x + 2 * x**2 - x**3, 2 - 5 * x**2 + 3 * x**3, x + 4 * x**2 - 3 * x**3, x**3 - x**2], axis=1
    )
    weights = np.zeros((len(at), count + 2))
    np.put_along_axis(weights, span[:, None] + np.arange(4), values, axis=1)
    # beyond an end, the rope goes on straight
    weights[:, 1] += 2.0 * weights[:, 0]
    weights[:, 2] -= weights[:, 0]
    weights[:, -2] += 2.0 * weights[:, -1]
    weights[:, -3] -= weights[:, -1]
    return freeze_array(weights[:, 1:-1])
