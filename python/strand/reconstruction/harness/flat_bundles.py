"""Wires that lie side by side under ties: wide and low, where a round bundle is as high as wide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from strand._core import TubeFit
from strand.geometry.plane import Plane
from strand.geometry.polyline import path_length
from strand.reconstruction.harness.places import Decisions
from strand.reconstruction.harness.ports import measure_along
from strand.reconstruction.harness.strands import Strand, smooth_nodes, take_medians
from strand.reconstruction.harness.surface_map import SurfaceMap, find_normals
from strand.support.checks import Array

_FLAT = 0.59  # height of the surface over the table at most, widths: two wires side by side have a half
_MOST = 20  # wires side by side: strands that are lower are no ropes, or the table is not where it seems
_INSIDE = (0.125, 0.875)  # stretch of a strand that tells, of its nodes
_LOW = 35.0  # percentile of a strand's heights where it lies on the table: other parts lie on strands
_LOWEST = 0.4  # half widths: a lower radius by height is none, since the table is not where it seems
_TIE = 0.25  # height of a tie over the wires' backs at least, radii of a wire
_NEAR_TIE = 5.0  # distance of a tie from a junction that it is at most, radii of a wire
_UNDER_TIES = 9  # nodes whose median is the height without ties
_SMOOTHING = 2.0  # nodes: standard deviation of the smoothing of heights
_CORNER = 2.0  # length at a free end in which the middle line runs to a corner, half widths
_MARCH = 0.25  # step in which the middle is sought there, half widths
_MAX_MARCHES = 40
_SIDES = 2.0  # half widths: distance from the middle line in which a strand's sides are sought
_SIDE_STEP = 0.5  # cells: the steps in which they are sought
_EVEN = 0.15  # difference of a strand's width from its usual one where its sides tell its middle, widths
_ROUNDS = 2  # of moving a strand to the middle between its sides
_WHOLE = 0.8  # of its width: shorter cuts go through a corner


@dataclass(frozen=True, eq=False)
class FlatBundles:
    """Strands whose wires lie side by side.

    Attributes
    ----------
    wires : (K,) ndarray of int
        The number of wires side by side of each strand; 1 for a round one.
    radius : float
        Of such a wire, metres; 0 without a flat strand.
    up : (3,) ndarray
        Unit vector across the plane in which they lie.
    lying : (K,) ndarray
        The radius of each strand by the height of its back, if it is round and lies on the table, metres;
        infinite where the height tells none.
    """

    wires: NDArray[np.int64]
    radius: float
    up: Array
    lying: Array

    @property
    def flat(self) -> NDArray[np.bool_]:
        """Which strands (K,) are wires side by side."""
        return self.wires > 1

    @property
    def owners(self) -> NDArray[np.int64]:
        """The strand (C,) of each tube: one for a round strand, one for each wire of a flat one."""
        return np.repeat(np.arange(len(self.wires)), self.wires)

    @property
    def classes(self) -> NDArray[np.int64]:
        """Which radius each strand's tubes (K,) have: round strands have their own, all wires share one."""
        own = np.cumsum(~self.flat) - 1
        return np.where(self.flat, np.count_nonzero(~self.flat), own)

    def list_radii(self, widths: Array) -> Array:
        """Return the radius of each class of tubes, metres, from those (K,) of strands as round bundles."""
        wires = (widths / np.sqrt(self.wires))[self.flat]
        return np.append(widths[~self.flat], np.median(wires) if len(wires) else [])

    def list_spreads(self, round_sd: float, flat_sd: float) -> Array:
        """Return a deviation for each class of tubes: of round strands, and of wires side by side."""
        return np.append(
            np.full(np.count_nonzero(~self.flat), round_sd), [flat_sd] if self.flat.any() else []
        )

    def list_widths(self, radii: Array) -> Array:
        """Return the radius (K,) of each strand as a round bundle, metres, from those of the classes."""
        return np.asarray(radii[self.classes] * np.sqrt(self.wires))

    def lay(self, curves: Sequence[Array]) -> list[Array]:
        """Return control points of all tubes: those of a flat strand lie beside its middle line."""
        tubes = []
        for control, count in zip(curves, self.wires, strict=True):
            across = np.cross(self.up, np.gradient(control, axis=0))
            across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
            for place in (2.0 * np.arange(count) - count + 1.0) * self.radius:
                tubes.append(control + place * across)
        return tubes

    def merge(self, fit: TubeFit, radii: Array) -> TubeFit:
        """Return a fit of tubes with one curve for each strand: the mean of its tubes.

        Parameters
        ----------
        fit : TubeFit
        radii : (K,) ndarray
            The radius of each strand, metres.
        """
        owners, first = self.owners, np.cumsum(self.wires) - self.wires
        classes = fit.radius_classes[first]

        def average(values: Sequence[Array]) -> list[Array]:
            pieces = [values[at : at + count] for at, count in zip(first, self.wires, strict=True)]
            return [np.mean(some, axis=0) for some in pieces]

        return fit.replace(
            curves=average(fit.curves),
            covariances=average(fit.covariances),
            curve=owners[fit.curve],
            radius_classes=np.arange(len(self.wires)),
            radii=radii,
            radii_sd=fit.radii_sd[classes],
            bands=fit.bands[classes],
        )


def find_flat_bundles(
    strands: Sequence[Strand], drawn: SurfaceMap, table: Plane | None, wire: float | None
) -> FlatBundles:
    """Tell which strands are wires side by side; without a table, none.

    Parameters
    ----------
    strands : sequence of Strand
    drawn : SurfaceMap
    table : Plane or None
    wire : float or None
        The radius of a wire, metres, if it is known.
    """
    wires, up = np.ones(len(strands), dtype=np.int64), drawn.frame[:, 2]
    if table is None:
        return FlatBundles(wires, 0.0, up, np.full(len(strands), np.inf))
    shapes = [_measure_shape(strand, drawn, table) for strand in strands]
    heights, lows, halves = np.array(shapes).T
    widths = np.array([strand.half_width for strand in strands])
    lying = lows / (1.0 + drawn.ridge)
    lying = np.where(lying > _LOWEST * widths, lying, np.inf)
    shares = heights / ((1.0 + drawn.ridge) * widths)
    flat = (shares < _FLAT) & (shares > 1.0 / _MOST)
    if not flat.any():
        return FlatBundles(wires, 0.0, up, lying)
    radius = float(np.median(heights[flat])) / (1.0 + drawn.ridge) if wire is None else wire
    wires[flat] = np.maximum(np.rint(halves[flat] / radius), 2)
    return FlatBundles(wires, radius, up, lying)


def _measure_shape(strand: Strand, drawn: SurfaceMap, table: Plane) -> tuple[float, float, float]:
    """Return the height of a strand's back over the table, a low one, and its half width if flat, metres."""
    first, last = (round(share * len(strand.nodes)) for share in _INSIDE)
    places, heights = drawn.flatten(strand.nodes[first:last])
    _, backs = drawn.sample_backs(places, strand.half_width / drawn.cell)
    low, height = np.percentile(table.measure_heights(drawn.lift(places, backs)), (_LOW, 50.0)).tolist()
    # a map drawn aslant shows flat strands narrower
    across = find_normals(places)
    steps = drawn.lift(places + across, heights) - drawn.lift(places, heights)
    aslant = np.linalg.norm(steps, axis=1)
    low_side, high_side = _find_sides(places, across, strand.half_width / drawn.cell, drawn)
    return height, low, 0.5 * float(np.median(aslant * (high_side - low_side)))


def hold_at_ties(
    decided: Decisions, strands: Sequence[Strand], bundles: FlatBundles, drawn: SurfaceMap
) -> Decisions:
    """Return decisions whose junctions of flat bundles lie at a tie near them, a bump across all wires.

    Wires part behind the last tie.
    """
    junctions = list(decided.junctions)
    for number, junction in enumerate(junctions):
        at = [
            (strand.half_width if is_flat else 0.0, drawn.flatten(strand.nodes)[0][:: 1 if end else -1])
            for strand, is_flat in zip(strands, bundles.flat, strict=True)
            for end in (0, 1)
            if strand.ends[end] == number
        ]
        half, trunk = max(at, key=lambda found: found[0], default=(0.0, np.zeros((0, 2))))
        if half == 0.0:
            continue
        others = [places[::-1] for _, places in at if places is not trunk]
        near = np.stack([junction.place, junction.hub])
        tie = _find_tie(trunk, others, near, half / drawn.cell, bundles.radius / drawn.cell, drawn)
        if tie is not None:
            junctions[number] = replace(junction, place=tie, tied=True)
    return replace(decided, junctions=junctions)


def _find_tie(
    places: Array, others: Sequence[Array], near: Array, half: float, wire: float, drawn: SurfaceMap
) -> Array | None:
    """Return the cell of the last tie of a flat strand that is near one of two places; None if none is.

    Behind the end, the line goes on in the middle between the strands that leave there.
    """
    reach = _NEAR_TIE * wire
    steps = np.arange(0.5, reach + float(np.linalg.norm(near[1] - near[0])), 0.5)
    ways = [
        np.column_stack([np.interp(steps, measure_along(other), other[:, axis]) for axis in (0, 1)])
        for other in others
    ]
    line = np.concatenate([places, np.mean(ways, axis=0)]) if ways else places
    away = np.linalg.norm(line[:, None] - near, axis=2).min(axis=1)
    around, backs = drawn.sample_backs(line, half)
    top = float(np.median(backs[: len(places)])) + _TIE * wire * drawn.cell
    high = (backs > top) & (away < reach) & drawn.hold(line)
    if not high.any():
        return None
    last = int(np.flatnonzero(high)[-1])
    first = last - int(np.argmin(np.append(high[: last + 1][::-1], False))) + 1
    # the line may leave the bundle's middle
    bump = around[first : last + 1].reshape(-1, 2)
    return np.asarray(bump[drawn.sample_heights(bump) > top].mean(axis=0))


def _find_sides(places: Array, across: Array, half: float, drawn: SurfaceMap) -> tuple[Array, Array]:
    """Return how far the mask reaches from places (M, 2) against and along unit vectors (M, 2), cells.

    Places beside the mask have a side of 0. The mask is followed up to some half widths.
    """
    steps = np.arange(0.0, _SIDES * max(half, 1.0), _SIDE_STEP)
    sides = []
    for sign in (-1.0, 1.0):
        around = places[:, None] + (sign * steps)[:, None] * across[:, None]
        on = drawn.hold(around.reshape(-1, 2)).reshape(len(places), -1)
        count = np.where(on.all(axis=1), len(steps), np.argmin(on, axis=1))
        # the edge lies half way to the first step beside the mask
        sides.append(sign * _SIDE_STEP * np.maximum(count - 0.5, 0.0))
    return sides[0], sides[1]


def lay_strands(strands: Sequence[Strand], bundles: FlatBundles, drawn: SurfaceMap) -> list[Strand]:
    """Return strands of which flat ones lie as high as their wires, and end in the middle.

    The middle line of a wide strand's mask runs to a corner of its end.
    """
    laid = []
    for strand, is_flat in zip(strands, bundles.flat, strict=True):
        if is_flat:
            strand = _move_to_middle(strand, drawn)
        if is_flat and not strand.closed:
            strand = _lead_to_ends(strand, drawn)
        laid.append(_lift_to_backs(strand, bundles.radius, drawn) if is_flat else strand)
    return laid


def _lift_to_backs(strand: Strand, wire: float, drawn: SurfaceMap) -> Strand:
    """Return a strand a wire's radius below the backs of its wires, metres; ties do not count."""
    places, _ = drawn.flatten(strand.nodes)
    _, backs = drawn.sample_backs(places, strand.half_width / drawn.cell)
    heights = smooth_nodes(take_medians(backs, _UNDER_TIES)[:, None], _SMOOTHING)[:, 0] - drawn.ridge * wire
    return replace(strand, nodes=drawn.lift(places, heights))


def _move_to_middle(strand: Strand, drawn: SurfaceMap) -> Strand:
    """Return a strand in the middle between the sides of its mask, where these are as far apart as usual.

    Thinning cuts the bends of wide strands. Between such places, nodes move evenly; those at junctions stay.
    """
    places, heights = drawn.flatten(strand.nodes)
    half = strand.half_width / drawn.cell
    for _ in range(_ROUNDS):
        across = find_normals(places)
        low, high = _find_sides(places, across, half, drawn)
        # of two widths, one that occurs
        usual = float(np.percentile(high - low, 50.0, method="lower"))
        whole = np.abs(high - low - usual) <= _EVEN * usual
        whole[[0, -1]] |= [end is not None for end in strand.ends]
        aside = 0.5 * (low + high)
        aside[[0, -1]] *= [end is None for end in strand.ends]
        along = measure_along(places)
        moved = np.interp(along, along[whole], aside[whole])
        places = places + smooth_nodes(moved[:, None], _SMOOTHING) * across
    return replace(strand, nodes=drawn.lift(places, heights))


def _lead_to_ends(strand: Strand, drawn: SurfaceMap) -> Strand:
    """Return a strand that keeps in the middle between its mask's sides up to its free ends."""
    nodes = strand.nodes
    for late in (0, 1):
        along = path_length(nodes)
        cut = _CORNER * strand.half_width
        if strand.ends[late] is not None or along[-1] < 2.0 * cut:
            continue
        nodes = nodes if late else nodes[::-1]
        kept = nodes[path_length(nodes) <= along[-1] - cut]
        places, heights = drawn.flatten(kept)
        beyond = _march(places, strand.half_width / drawn.cell, drawn)
        added = drawn.lift(beyond, np.full(len(beyond), heights[-1]))
        nodes = np.concatenate([kept, added])
        nodes = nodes if late else nodes[::-1]
    return replace(strand, nodes=nodes)


def _march(places: Array, half: float, drawn: SurfaceMap) -> Array:
    """Return places (M, 2) in the middle of a mask beyond a line's last place, in steps, up to its end."""
    tip, step = places[-1], _MARCH * half
    inner = places[np.linalg.norm(places - tip, axis=1) <= half]
    heading = tip - inner[0] if len(inner) > 1 else tip - places[-2]
    heading = heading / max(float(np.linalg.norm(heading)), 1e-9)
    found: list[Array] = []
    for _ in range(_MAX_MARCHES):
        ahead = tip + step * heading
        if not drawn.holds(ahead):
            break
        across = np.array([-heading[1], heading[0]])
        left, right = (float(side[0]) for side in _find_sides(ahead[None], across[None], half, drawn))
        # a cut at a corner is shorter, and its middle lies aside
        if right - left > _WHOLE * 2.0 * half:
            ahead = ahead + 0.5 * (left + right) * across
        heading = ahead - (found[-2] if len(found) > 1 else tip)
        heading = heading / max(float(np.linalg.norm(heading)), 1e-9)
        found.append(ahead)
        tip = ahead
    return np.array(found).reshape(-1, 2)
