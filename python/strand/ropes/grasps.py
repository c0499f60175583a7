"""Grasps of a gripper with two parallel jaws: where it can hold a rope, ranked, and why not elsewhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, product
from math import ceil, inf
from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand.geometry.frames import check_direction
from strand.geometry.line import Line
from strand.geometry.plane import Plane
from strand.ropes.crossings import Crossing
from strand.ropes.seen_side import check_table
from strand.support.checks import Array, check_nonnegative, check_positive

_TURNS = np.radians([0.0, -15.0, 15.0, -30.0, 30.0])  # radians: tried turns of the approach about the rope
_OPENINGS = (1.0, 0.5, 0.2, 0.0)  # tried openings, as fractions between the least and the greatest
_TIP_REACHES = (1.0, 0.3)  # radii: tried reaches of the tips below the rope's axis
_STEP = 0.5  # radii: length of the steps into which ropes are cut
_MAX_STEPS = 200_000  # of all ropes; longer steps beyond
_RETURN = 0.5  # radii that a rope runs back before it counts as another leg
_MAX_BEND_OVERLAP = 0.05  # radii that a bend may enter the fingers' clearance
_PLACE_SDS = 2.0  # standard deviations of the rope's place, and of its end's, that the fingers allow for
_MAX_SIDE = 1.0  # metres: no gripper has longer fingers or opens wider
_STEEP_ANGLE = np.radians(45.0)  # radians: a rope this near to the approach cannot be held

REASONS = {
    "thick": "the rope is too thick for the jaws",
    "unseen": "no point supports the rope here",
    "steep": "the rope runs along the approach",
    "unsure": "the rope's place is too uncertain for the jaws",
    "between": "another strand, or the other leg of a bend, lies between the jaws",
    "fingers": "another strand is in the way of a finger or of the palm",
    "bend": "the rope bends too tightly for the fingers",
    "end": "a finger would reach past the rope's end",
    "table": "the table is in the way of a finger or of the palm",
}
"""Reasons why a place has no grasp, by kind."""


@dataclass(frozen=True)
class Gripper:
    """Two fingers that close towards each other, below a palm. All in metres.

    Parameters
    ----------
    opening : float
        Greatest distance between the fingers' inner faces.
    width : float
        Width of a finger, along the rope.
    thickness : float
        Thickness of a finger, from its inner to its outer face.
    depth : float
        Length from the palm to the fingers' tips.
    clearance : float
        Least distance to whatever the gripper must not touch.

    Raises
    ------
    TypeError
        If a value is not a number.
    ValueError
        If a length is not positive, `clearance` is negative, or one is over 1 m, as millimetres are.
    """

    opening: float
    width: float
    thickness: float
    depth: float
    clearance: float = 0.001

    def __post_init__(self) -> None:
        for name in ("opening", "width", "thickness", "depth"):
            object.__setattr__(self, name, check_positive(name, getattr(self, name)))
        object.__setattr__(self, "clearance", check_nonnegative("clearance", self.clearance))
        for name, value in vars(self).items():
            if value > _MAX_SIDE:
                raise ValueError(f"{name}: expected at most {_MAX_SIDE:g} m, got {value:g}; is it in metres?")


@dataclass(frozen=True, eq=False)
class Grasp:
    """One way to hold a rope.

    Attributes
    ----------
    chain : int
        Number of the chain.
    s : float
        Arc length of the place, metres.
    pose : (4, 4) ndarray
        Gripper-to-world pose, metres. The origin is on the rope's axis. x runs along the rope, y from jaw to
        jaw, and z is the approach from the palm to the rope.
    width : float
        Opening of the jaws, metres.
    tip : float
        Reach of the tips beyond the rope's axis, along z, metres.
    clearance : float
        Distance of fingers and palm from the nearest other strand, metres; infinite without one.
    table_clearance : float
        Distance of fingers and palm from the table, metres; NaN without a given table.
    free : (float, float)
        Length of rope before and after the place to the next crossing or end, metres.
    on_top : bool
        Whether the rope is the upper one at the nearer of these crossings; True without any.
    score : float
        Rank among the grasps, from 0 to 1, see `Model.grasps`.
    """

    chain: int
    s: float
    pose: Array
    width: float
    tip: float
    clearance: float
    table_clearance: float
    free: tuple[float, float]
    on_top: bool
    score: float

    @property
    def approach(self) -> Array:
        """(3,) Unit vector from the palm to the rope."""
        return self.pose[:3, 2]

    @property
    def jaw_axis(self) -> Array:
        """(3,) Unit vector from jaw to jaw, across the rope."""
        return self.pose[:3, 1]

    def __str__(self) -> str:
        return (
            f"chain {self.chain} at {self.s * 1e3:.0f} mm, jaws {self.width * 1e3:.1f} mm open, "
            f"score {self.score:.2f}"
        )


@dataclass(frozen=True)
class NoGrasp:
    """A stretch of rope that cannot be held, and why.

    Attributes
    ----------
    chain : int
        Number of the chain.
    stretch : (float, float)
        Arc lengths of the first and the last tried place, metres.
    kind : str
        One of `strand.ropes.grasps.REASONS`.
    """

    chain: int
    stretch: tuple[float, float]
    kind: str

    def __str__(self) -> str:
        start, stop = (1e3 * s for s in self.stretch)
        return f"chain {self.chain} from {start:.0f} to {stop:.0f} mm: {REASONS[self.kind]}"


@dataclass(frozen=True, eq=False)
class Grasps:
    """Grasps, the best first; a sequence of them.

    Attributes
    ----------
    found : tuple of Grasp
        At most one for each tried place.
    refused : tuple of NoGrasp
        The other places, in order along the chains.
    """

    found: tuple[Grasp, ...]
    refused: tuple[NoGrasp, ...]

    def __repr__(self) -> str:
        return f"Grasps({len(self.found)} found, {len(self.refused)} stretches refused)"

    def __str__(self) -> str:
        """Return the best grasp and the reasons why other stretches have none, in words."""
        best = f"{len(self.found)} places to hold, the best: {self.found[0]}" if self.found else "no grasp"
        kinds = Counter(one.kind for one in self.refused)
        lines = [f"{count} stretches without one: {REASONS[kind]}" for kind, count in kinds.most_common()]
        return "\n".join([best, *lines])

    def __len__(self) -> int:
        return len(self.found)

    @overload
    def __getitem__(self, number: int) -> Grasp: ...

    @overload
    def __getitem__(self, number: slice) -> tuple[Grasp, ...]: ...

    def __getitem__(self, number: int | slice) -> Grasp | tuple[Grasp, ...]:
        return self.found[number]

    def __iter__(self) -> Iterator[Grasp]:
        return iter(self.found)


@dataclass(frozen=True)
class _Steps:
    """All ropes in small, even steps: places (S, 3), arc lengths, chain numbers and radii (S,)."""

    places: Array
    s: Array
    chain: NDArray[np.intp]
    radius: Array


def find_grasps(
    chains: Sequence[Line],
    gripper: Gripper,
    crossings: Sequence[Crossing],
    table: tuple[ArrayLike, float] | None,
    direction: ArrayLike,
) -> Grasps:
    """Find where a gripper can hold the ropes, see `Model.grasps`."""
    if not isinstance(gripper, Gripper):
        raise TypeError(f"gripper: expected a Gripper, got {type(gripper).__name__}")
    towards, plane = (
        check_direction("direction", direction),
        None if table is None else check_table("table", table),
    )
    found: list[Grasp] = []
    refused: list[NoGrasp] = []
    if not chains:
        return Grasps((), ())
    steps = _cut_steps(chains)
    for i, chain in enumerate(chains):
        passes = [(at[1], one.over is at) for one in crossings for at in (one.over, one.under) if at[0] == i]
        tried = max(ceil(chain.length / max(0.5 * gripper.width, chain.radius)), 1)
        kinds = []
        places = ((np.arange(tried) + 0.5) / tried * chain.length).tolist()
        for s in places:
            one = _try_place(chain, i, s, gripper, steps, plane, towards, passes)
            if isinstance(one, Grasp):
                found.append(one)
            kinds.append("" if isinstance(one, Grasp) else one)
        for kind, group in groupby(zip(places, kinds, strict=True), key=lambda pair: pair[1]):
            stretch = [s for s, _ in group]
            if kind:
                refused.append(NoGrasp(i, (stretch[0], stretch[-1]), kind))
    return Grasps(tuple(sorted(found, key=lambda grasp: -grasp.score)), tuple(refused))


def _cut_steps(chains: Sequence[Line]) -> _Steps:
    step = max(
        _STEP * min(chain.radius for chain in chains), sum(chain.length for chain in chains) / _MAX_STEPS
    )
    arcs = [
        np.linspace(0.0, chain.length, ceil(chain.length / step) + 1, endpoint=not chain.closed)
        for chain in chains
    ]
    return _Steps(
        np.concatenate([chain.at(s) for chain, s in zip(chains, arcs, strict=True)]),
        np.concatenate(arcs),
        np.repeat(np.arange(len(chains)), [len(s) for s in arcs]),
        np.repeat([chain.radius for chain in chains], [len(s) for s in arcs]),
    )


def _try_place(
    chain: Line,
    which: int,
    s: float,
    gripper: Gripper,
    steps: _Steps,
    table: Plane | None,
    towards: Array,
    passes: Sequence[tuple[float, bool]],
) -> Grasp | str:
    """Return the best grasp at a place, or the kind of reason why there is none."""
    least = 2.0 * (chain.radius + gripper.clearance)
    if least > gripper.opening:
        return "thick"
    if chain.bridged[np.abs(chain.arc_length - s).argmin()]:
        return "unseen"
    place, x = chain.at(s), chain.tangent_at(s)
    straight = -(towards - (towards @ x) * x)
    if np.linalg.norm(straight) < np.sin(_STEEP_ANGLE):
        return "steep"
    straight /= np.linalg.norm(straight)
    spread = _measure_spread(chain, s, np.cross(straight, x))
    if least + 2.0 * spread > gripper.opening:
        return "unsure"
    widths = [least + 2.0 * spread + share * (gripper.opening - least - 2.0 * spread) for share in _OPENINGS]
    near, mine, held = _select_steps(place, x, gripper, steps, which, s, chain)
    free, shortest, on_top = _measure_free(chain, s, passes)
    best: Grasp | None = None
    worst = "table"
    for turn in _TURNS:
        z = np.cos(turn) * straight + np.sin(turn) * np.cross(x, straight)
        axes = np.column_stack([x, np.cross(z, x), z])
        local = (steps.places[near] - place) @ axes
        for below, width in product(_TIP_REACHES, widths):
            tip = below * chain.radius
            gap = np.nan
            if table is not None:
                gap = _measure_height(table, place, axes, tip, width, gripper)
                # raise the tips off the table, while they still reach around the rope
                tip -= max(gripper.clearance - gap, 0.0) / max(-float(table[0] @ z), 1e-9)
                gap = max(gap, gripper.clearance)
            if tip < 0.0:
                continue
            fault, clearance = _find_obstacle(local, steps.radius[near], mine, held, tip, width, gripper)
            if fault:
                worst = fault if turn == 0.0 else worst
                continue
            parts = (
                1.0 if np.isinf(clearance) else clearance / (clearance + 0.5 * gripper.opening),
                1.0 if np.isinf(shortest) else shortest / (shortest + gripper.opening),
                float(on_top),
                float(np.cos(turn)) ** 4,
            )
            score = sum(parts) / len(parts)
            if best is None or score > best.score:
                pose = np.eye(4)
                pose[:3, :3], pose[:3, 3] = axes, place
                best = Grasp(which, s, pose, width, tip, clearance, gap, free, on_top, score)
    if best is None:
        return worst
    return best if _fits_between_ends(chain, s, gripper.width) else "end"


def _measure_spread(chain: Line, s: float, direction: Array) -> float:
    """Return by how much the rope may lie elsewhere along a unit vector, metres."""
    if chain.covariance is None:
        return 0.0
    variance = float(direction @ chain.interpolated(chain.covariance, s) @ direction)
    return _PLACE_SDS * float(np.sqrt(max(variance, 0.0)))


def _fits_between_ends(chain: Line, s: float, width: float) -> bool:
    """Return whether fingers of a width hold rope along all of it, wherever the ends may be."""
    ends = () if chain.closed else (0.0, chain.length)
    return all(
        abs(s - end) >= 0.5 * width + _measure_spread(chain, end, chain.tangent_at(end)) for end in ends
    )


def _select_steps(
    place: Array, x: Array, gripper: Gripper, steps: _Steps, which: int, s: float, chain: Line
) -> tuple[NDArray[np.intp], NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the steps near the gripper, and which of them belong to the held stretch and the held leg.

    `x` is the rope's direction at the place.
    """
    reach = gripper.opening + 2.0 * gripper.thickness + gripper.width + 2.0 * gripper.depth
    away = np.linalg.norm(steps.places - place, axis=1)
    near = np.flatnonzero(away < reach + 2.0 * steps.radius.max())
    own = np.flatnonzero(steps.chain == which)
    middle = int(np.abs(steps.s[own] - s).argmin())
    mine, held = np.zeros(len(away), dtype=bool), np.zeros(len(away), dtype=bool)
    half = len(own) // 2 if chain.closed else len(own)
    for way in (1, -1):
        path = np.roll(own, -middle)[:half] if chain.closed else own[middle:]
        if way < 0:
            path = np.roll(own[::-1], middle + 1)[:half] if chain.closed else own[middle::-1]
        path = path[: _count_outward(away[path], chain.radius)]
        mine[path] = True
        # for the jaws, the other leg of a bend is a second strand before it comes back to the place
        held[path[: _count_outward(way * ((steps.places[path] - place) @ x), _RETURN * chain.radius)]] = True
    return near, mine[near], held[near]


def _count_outward(far: Array, least: float) -> int | None:
    """Return the number of steps until the distance shrinks by `least`; None if it never does."""
    back = np.flatnonzero(np.maximum.accumulate(far) - far > least)
    return int(back[0]) if len(back) else None


def _find_obstacle(
    local: Array,
    radius: Array,
    mine: NDArray[np.bool_],
    held: NDArray[np.bool_],
    tip: float,
    width: float,
    gripper: Gripper,
) -> tuple[str, float]:
    """Return the kind of obstacle, or "", and the clearance to other strands.

    `local` are the steps' places in the gripper's frame.
    """
    along = np.maximum(np.abs(local[:, 0]) - 0.5 * gripper.width, 0.0)
    across = np.abs(local[:, 1])
    inner, outer = 0.5 * width, 0.5 * width + gripper.thickness
    wide = 0.5 * gripper.opening + gripper.thickness
    top = tip - gripper.depth
    deep = np.maximum(np.maximum(local[:, 2] - tip, top - local[:, 2]), 0.0)
    palm = np.maximum(np.maximum(local[:, 2] - top, top - gripper.depth - local[:, 2]), 0.0)
    fingers = _compute_norm(along, np.maximum(np.maximum(inner - across, across - outer), 0.0), deep) - radius
    between = _compute_norm(along, np.maximum(across - inner, 0.0), deep) - radius
    body = np.minimum(fingers, _compute_norm(along, np.maximum(across - wide, 0.0), palm) - radius)
    if (between[~held] < 0.0).any():
        return "between", 0.0
    clearance = float(body[~mine].min(initial=inf))
    if clearance < gripper.clearance:
        return "fingers", clearance
    # a rope that just fits does not bend too tightly
    if (body[mine] < gripper.clearance - 1e-9 - _MAX_BEND_OVERLAP * radius[mine]).any():
        return "bend", clearance
    return "", clearance


def _compute_norm(x: Array, y: Array, z: Array) -> Array:
    return np.asarray(np.sqrt(x * x + y * y + z * z))


def _measure_height(
    table: Plane, place: Array, axes: Array, tip: float, width: float, gripper: Gripper
) -> float:
    """Return the height of the lowest corner of fingers and palm above the table, metres."""
    normal, offset = table
    along, across, ahead = abs(normal @ axes[:, 0]), abs(normal @ axes[:, 1]), normal @ axes[:, 2]
    lowest = []
    # half the extent from jaw to jaw, and both ends along the approach, of fingers and palm
    for wide, far, near in (
        (0.5 * width + gripper.thickness, tip, tip - gripper.depth),
        (0.5 * gripper.opening + gripper.thickness, tip - gripper.depth, tip - 2.0 * gripper.depth),
    ):
        lowest.append(min(far * ahead, near * ahead) - 0.5 * gripper.width * along - wide * across)
    return float(normal @ place - offset + min(lowest))


def _measure_free(
    chain: Line, s: float, passes: Sequence[tuple[float, bool]]
) -> tuple[tuple[float, float], float, bool]:
    """Return the lengths to the next crossings before and after, the shorter one, and whether it is on top.

    Without a crossing on a side, the length is that to the end; without any the shorter one is infinite.
    """
    if not passes:
        return (s, chain.length - s), inf, True
    at, upper = np.array([place for place, _ in passes]), np.array([top for _, top in passes])
    ahead, behind = at - s, s - at
    if chain.closed:
        ahead, behind = ahead % chain.length, behind % chain.length
    before = float(behind[behind >= 0].min(initial=s if not chain.closed else inf))
    after = float(ahead[ahead >= 0].min(initial=chain.length - s if not chain.closed else inf))
    away = np.minimum(np.where(ahead >= 0, ahead, inf), np.where(behind >= 0, behind, inf))
    return (before, after), float(away.min()), bool(upper[away.argmin()])
