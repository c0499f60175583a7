"""Crossings of ropes with each other and with themselves, as seen from a direction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from strand._core import find_crossed_segments
from strand.geometry.frames import check_direction
from strand.geometry.line import Line
from strand.ropes.clearance import find_least_distances
from strand.ropes.doubt import Doubt
from strand.ropes.joints import Ends, meet_at_node
from strand.ropes.order import estimate_order_probability, measure_order
from strand.support.checks import (
    Array,
    check_fraction_or_nan,
    check_integer,
    check_nonnegative,
    check_number,
    check_sequence,
    check_small_array,
    freeze_array,
)

Places = tuple[NDArray[np.intp], Array]
"""(K,), (K,) Numbers of chains, and arc lengths on them."""

# a rope that bends no tighter than its radius needs 3.7 radii to come to lie two radii above itself
_MIN_BETWEEN = 4.0  # radii of rope between two strands; within less it only bends
_SIDE_BY_SIDE_SINE = 0.5  # sine of the angle of two strands; below it they run side by side
# a model whose crossings are listed has so many at most: noise has millions
_MAX_NODES = 8_000
_MAX_LISTED = 10_000  # crossings of segments, those within bends included
NOT_LISTED = f"crossings are not listed: there are over {_MAX_NODES:,} nodes or {_MAX_LISTED:,} crossings"
"""Words for a model of which `list_crossings` returns None."""
_NEWTON_STEPS = 4  # at most
_SAME_PLACE = 1e-12  # of a chain's length: nearer places are the same


@dataclass(frozen=True, eq=False)
class Crossing:
    """One strand over another, as seen from a direction; `str()` describes it in words.

    Attributes
    ----------
    over, under : (int, float)
        Chain number and arc length, metres, of the strand nearer to the viewer, and of the other one.
    point_over, point_under : (3,) ndarray
        Places of both axes on the same line of sight, world frame, metres.
    height : float
        Distance of these places along the direction, metres, 0 or above.
    height_sd : float
        Standard deviation of `height`, metres, from the covariances of both chains: that of the distance of
        the axes, over its cosine with the direction. NaN if a chain has no covariance.
    gap : float
        Clearance between the surfaces, metres: the least distance of the axes around the crossing, minus both
        radii. Negative if the tubes of the model intersect. The search covers `height` plus four mean radii
        to either side, but no places of one rope within four radii of rope of each other.
    angle : float
        Angle between the strands in projection, whichever way they run, radians, from 0 to pi/2.
    sign : int
        1 at a right-handed crossing, else -1. Right-handed means that the upper strand has to turn left, by
        less than half a turn, to run as the lower one. The sign is the same from either side, and changes if
        one of two chains is reversed.
    probability : float
        Probability that there are two strands and that the upper one lies on top, from 0 to 1. It depends on
        `height`, its standard deviation, the radii, and doubts at this place.
    """

    over: tuple[int, float]
    under: tuple[int, float]
    point_over: Array
    point_under: Array
    height: float
    height_sd: float
    gap: float
    angle: float
    sign: int
    probability: float

    def __post_init__(self) -> None:
        for name in ("over", "under"):
            at = check_sequence(name, getattr(self, name), "a chain's number and an arc length")
            if len(at) != 2:
                raise ValueError(f"{name}: expected a chain's number and an arc length, got {len(at)} values")
            object.__setattr__(
                self, name, (check_integer(f"{name}[0]", at[0]), check_number(f"{name}[1]", at[1]))
            )
        for name in ("point_over", "point_under"):
            object.__setattr__(self, name, freeze_array(check_small_array(name, getattr(self, name), (3,))))
        for name in ("height", "gap", "angle"):
            object.__setattr__(self, name, check_number(name, getattr(self, name)))
        sd = self.height_sd
        unknown = sd is None or sd != sd
        object.__setattr__(self, "height_sd", float("nan") if unknown else check_nonnegative("height_sd", sd))
        if self.sign not in (1, -1):
            raise ValueError(f"sign: expected 1 or -1, got {self.sign!r}")
        object.__setattr__(self, "sign", int(self.sign))
        object.__setattr__(self, "probability", check_fraction_or_nan("probability", self.probability))

    def __str__(self) -> str:
        (upper, high), (lower, low) = self.over, self.under
        return (
            f"chain {upper} at {high * 1e3:.0f} mm passes over chain {lower} at {low * 1e3:.0f} mm, "
            f"probability {self.probability:.3f}"
        )

    @property
    def place(self) -> Array:
        """(3,) Middle between the strands, world frame, metres."""
        return np.asarray(0.5 * (self.point_over + self.point_under))


def find_crossings(
    chains: Sequence[Line],
    direction: ArrayLike,
    doubts: Sequence[Doubt],
    confidence: float = math.nan,
    ends: Ends = (),
) -> tuple[Crossing, ...]:
    """Find where chains cross in projection along a direction, see `Model.crossings`."""
    return _drop_joints(chains, ends, _find(chains, direction, doubts, confidence, None) or ())


def list_crossings(
    chains: Sequence[Line],
    direction: ArrayLike,
    doubts: Sequence[Doubt],
    confidence: float = math.nan,
    ends: Ends = (),
) -> tuple[Crossing, ...] | None:
    """Return crossings for files, tables and pages; None if there are too many to list, see `NOT_LISTED`."""
    if sum(len(chain.points) for chain in chains) > _MAX_NODES:
        return None
    met = _find(chains, direction, doubts, confidence, _MAX_LISTED)
    return None if met is None else _drop_joints(chains, ends, met)


def _drop_joints(chains: Sequence[Line], ends: Ends, crossings: tuple[Crossing, ...]) -> tuple[Crossing, ...]:
    """Return the crossings that are not where chains share a node."""
    return tuple(one for one in crossings if not meet_at_node(chains, ends, one.over, one.under))


def _find(
    chains: Sequence[Line], direction: ArrayLike, doubts: Sequence[Doubt], confidence: float, most: int | None
) -> tuple[Crossing, ...] | None:
    """Return crossings; None if more than `most` pairs of segments cross."""
    towards = check_direction("direction", direction)
    places = _intersect(chains, towards, most)
    if places is None:
        return None
    first, second, turns = places
    if not len(turns):
        return ()
    number, at = np.stack([first[0], second[0]]), np.stack([first[1], second[1]])
    point, tangent = (
        np.stack(both) for both in zip(_locate(chains, first), _locate(chains, second), strict=True)
    )
    covariance = np.stack([_interpolate_covariance(chains, first), _interpolate_covariance(chains, second)])
    rise = (point[0] - point[1]) @ towards
    upper = np.where(rise >= 0, 0, 1)
    height = np.abs(rise)
    across, lever, angle = _measure_distance_direction(tangent, towards)
    variance = np.einsum("ki,skij,kj->k", across, covariance, across)
    with np.errstate(divide="ignore"):
        sd = np.sqrt(np.maximum(variance, 0.0)) / lever
    radii = np.array([chain.radius for chain in chains])[number].sum(axis=0)
    gap = _measure_gap(chains, number, at, height, radii)
    evidence = measure_order(height, sd, radii, angle, point.mean(axis=0), doubts)
    probability = estimate_order_probability(evidence, confidence)
    order = np.stack([upper, 1 - upper]), np.arange(len(height))
    points = point[order]
    points.setflags(write=False)
    over, under = (
        zip(chain, s, strict=True)
        for chain, s in zip(number[order].tolist(), at[order].tolist(), strict=True)
    )
    columns = {
        "over": over,
        "under": under,
        "point_over": points[0],
        "point_under": points[1],
        "height": height.tolist(),
        "height_sd": sd.tolist(),
        "gap": gap.tolist(),
        "angle": angle.tolist(),
        "sign": np.where(upper == 0, turns, -turns).tolist(),
        "probability": probability.tolist(),
    }
    return tuple(_make(dict(zip(columns, row, strict=True))) for row in zip(*columns.values(), strict=True))


def _make(values: dict[str, Any]) -> Crossing:
    """Return the crossing with these attributes, which need no check."""
    crossing = object.__new__(Crossing)
    crossing.__dict__.update(values)
    return crossing


def find_free_stretch(
    chain: Line, number: int, s: float, crossings: Sequence[Crossing]
) -> tuple[float, float]:
    """Return the stretch around a place without crossings, see `Model.segment_between_crossings`."""
    place = check_number("s", s)
    if not 0.0 <= place <= chain.length:
        raise ValueError(f"s: expected an arc length from 0 to {chain.length:g} m, got {place:g}")
    met = np.array([at for one in crossings for i, at in (one.over, one.under) if i == number])
    if not len(met):
        return 0.0, chain.length
    if chain.closed:
        met = np.concatenate([met - chain.length, met, met + chain.length])
    else:
        met = np.append(met, [0.0, chain.length])
    return float(met[met <= place].max()), float(met[met >= place].min())


def _collect_segments(chains: Sequence[Line]) -> tuple[Array, NDArray[np.intp], NDArray[np.intp], Array]:
    """Return the nodes (N, 3) of all chains, and their S segments.

    Segments are (S, 2) numbers of nodes, (S,) numbers of chains, and (S, 2) arc lengths of both ends, metres.
    """
    nodes, segments, number, arcs = [np.empty((0, 3))], [], [], []
    count = 0
    for i, chain in enumerate(chains):
        here = np.arange(len(chain.points))
        ends = np.stack([here, np.roll(here, -1)], axis=1)
        arc = np.stack([chain.arc_length, np.append(chain.arc_length[1:], chain.length)], axis=1)
        kept = slice(None) if chain.closed else slice(-1)
        nodes.append(chain.points)
        segments.append(count + ends[kept])
        arcs.append(arc[kept])
        number.append(np.full(len(ends[kept]), i))
        count += len(here)
    none = np.empty(0, dtype=np.intp)
    return (
        np.concatenate(nodes),
        np.concatenate([none.reshape(0, 2), *segments]),
        np.concatenate([none, *number]),
        np.concatenate([np.empty((0, 2)), *arcs]),
    )


def _intersect(
    chains: Sequence[Line], towards: Array, most: int | None
) -> tuple[Places, Places, NDArray[np.int8]] | None:
    """Return both places where chains cross in projection, and to which side the second leaves the first.

    None if more than `most` pairs of segments cross.
    """
    aside = np.cross(towards, np.eye(3)[np.abs(towards).argmin()])
    aside /= np.linalg.norm(aside)
    basis = np.column_stack([aside, np.cross(towards, aside)])
    nodes, segments, number, arcs = _collect_segments(chains)
    origin = nodes.mean(axis=0) if len(nodes) else np.zeros(3)
    limit = None if most is None else most + 1
    pairs, shares, turns = find_crossed_segments((nodes - origin) @ basis, segments, limit)
    if most is not None and len(pairs) > most:
        return None
    which = number[pairs]
    at = arcs[pairs, 0] + shares * (arcs[pairs, 1] - arcs[pairs, 0])
    radius, length, closed = (
        np.array([getattr(chain, name) for chain in chains]) for name in ("radius", "length", "closed")
    )
    between = at[:, 1] - at[:, 0]
    if len(at):
        mine = which[:, 0]
        between = np.where(closed[mine], np.minimum(between, length[mine] - between), between)
        kept = (mine != which[:, 1]) | (between >= _MIN_BETWEEN * radius[mine])
        which, at, turns = which[kept], at[kept], turns[kept]
        kept = ~_find_touches(which, at, turns, length)
        which, at, turns = which[kept], at[kept], turns[kept]
    at = _refine(chains, which, at, basis)
    order = np.lexsort((at[:, 1], which[:, 1], at[:, 0], which[:, 0]))
    which, at = which[order], at[order]
    return (which[:, 0], at[:, 0]), (which[:, 1], at[:, 1]), turns[order]


def _find_touches(
    which: NDArray[np.intp], at: Array, turns: NDArray[np.int8], length: Array
) -> NDArray[np.bool_]:
    """Return (K,) whether a crossing cancels another one at its place: one strand only touches the other."""
    order = np.lexsort((at[:, 1], at[:, 0], which[:, 1], which[:, 0]))
    a, b = order[:-1], order[1:]
    same = (which[a] == which[b]).all(axis=1) & (turns[a] != turns[b])
    same &= (np.abs(at[a] - at[b]) <= _SAME_PLACE * length[which[a]]).all(axis=1)
    canceled = np.zeros(len(at), dtype=bool)
    for k in np.flatnonzero(same):
        if not canceled[a[k]]:
            canceled[[a[k], b[k]]] = True
    return canceled


def _refine(chains: Sequence[Line], which: NDArray[np.intp], at: Array, basis: Array) -> Array:
    """Return (K, 2) arc lengths where smooth curves cross in projection, by Newton's method from chords."""
    smooth = np.array([chain.curve is not None for chain in chains], dtype=bool)
    some = np.flatnonzero(smooth[which].all(axis=1)) if len(which) else np.empty(0, dtype=np.intp)
    if not len(some):
        return at
    spacing = np.array([chain.length / len(chain.points) for chain in chains])[which[some]]
    length = np.array([chain.length for chain in chains])[which[some]]
    start = s = at[some]
    for _ in range(_NEWTON_STEPS):
        both = _locate(chains, (which[some].T.ravel(), s.T.ravel()))
        point, tangent = (rows.reshape(2, -1, 3) for rows in both)
        (ax, ay), (bx, by) = (tangent[0] @ basis).T, (tangent[1] @ basis).T
        x, y = ((point[1] - point[0]) @ basis).T
        det = ax * by - ay * bx
        with np.errstate(divide="ignore", invalid="ignore"):
            move = np.stack([x * by - y * bx, x * ay - y * ax], axis=1) / det[:, None]
        # where strands run side by side a step may lead anywhere: keep these places
        before = s
        s = np.where(np.isfinite(move) & (np.abs(s + move - start) <= spacing), s + move, start)
        s = np.clip(s, 0.0, length)
        if (np.abs(s - before) <= _SAME_PLACE * length).all():
            break
    refined = at.copy()
    refined[some] = s
    return refined


def _locate(chains: Sequence[Line], places: Places) -> tuple[Array, Array]:
    """Return positions and unit tangents, (K, 3) each."""
    number, s = places
    point, tangent = np.empty((2, len(s), 3))
    for i in np.unique(number):
        here, chain = np.flatnonzero(number == i), chains[i]
        if chain.curve is None:
            point[here], tangent[here] = chain.at(s[here]), chain.tangent_at(s[here])
        else:
            point[here], tangent[here], _ = chain.curve.at(s[here])
    return point, tangent


def _interpolate_covariance(chains: Sequence[Line], places: Places) -> Array:
    """Return (K, 3, 3) covariances of positions, NaN where unknown."""
    number, s = places
    covariance = np.full((len(s), 3, 3), np.nan)
    for i in np.unique(number):
        here, chain = np.flatnonzero(number == i), chains[i]
        if chain.covariance is not None:
            covariance[here] = chain.interpolated(chain.covariance, s[here])
    return covariance


def _measure_gap(
    chains: Sequence[Line], number: NDArray[np.intp], at: Array, height: Array, radii: Array
) -> Array:
    """Return (K,) clearances between the surfaces around crossings, metres."""
    # the nearest place of a steep strand is as far along it as the height
    reach = np.broadcast_to(height + 0.5 * _MIN_BETWEEN * radii, at.shape)
    back, ahead = reach.copy(), reach.copy()
    for i in np.unique(number):
        chain, here = chains[i], number == i
        back[here] = np.minimum(back[here], 0.5 * chain.length if chain.closed else at[here])
        ahead[here] = np.minimum(ahead[here], 0.5 * chain.length if chain.closed else chain.length - at[here])
        mine = here.all(axis=0)
        between = at[1, mine] - at[0, mine]
        half = np.maximum(0.5 * (between - _MIN_BETWEEN * chain.radius), 0.0)
        ahead[0, mine], back[1, mine] = np.minimum(ahead[0, mine], half), np.minimum(back[1, mine], half)
        if chain.closed:
            half = np.maximum(0.5 * (chain.length - between - _MIN_BETWEEN * chain.radius), 0.0)
            back[0, mine], ahead[1, mine] = np.minimum(back[0, mine], half), np.minimum(ahead[1, mine], half)
    return find_least_distances(chains, number, at, back, ahead) - radii


def _measure_distance_direction(tangent: Array, towards: Array) -> tuple[Array, Array, Array]:
    """Return the direction of the distance of two strands, its cosine with `towards`, and the strands' angle.

    The distance is across both tangents, or across one of them where strands run nearly side by side.
    """
    across = np.cross(*tangent)
    beside = np.linalg.norm(across, axis=1) < _SIDE_BY_SIDE_SINE
    alone = towards - (tangent[0] @ towards)[:, None] * tangent[0]
    across = np.where(beside[:, None], alone, across)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-300)
    flat = tangent - (tangent @ towards)[..., None] * towards
    turn = np.linalg.norm(np.cross(*flat), axis=1)
    return across, np.abs(across @ towards), np.arctan2(turn, np.abs((flat[0] * flat[1]).sum(axis=1)))
