"""Free ends that go on where the map's mask ends: there a strand is seen aslant, or hangs down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import strand._core as _core
from strand.geometry.polyline import path_length
from strand.reconstruction.harness.ground import Ground
from strand.reconstruction.harness.strands import Strand
from strand.support.checks import Array

_BACK = 3.0  # distance before an end from which it is followed, half widths
_HEADING = 2.0  # length of the stretch before it that tells the direction there, half widths
_STEP = 0.5  # of following, half widths
_SURFACE = 1.3  # distance of a strand's points from its axis at most, half widths
_TUBE = 1.5  # distance of points that lead on from the way at most, half widths
_WIDE = 2.5  # the same of points that show that they are no rope's
_MAX_WIDE = 0.5  # number of these at most, over those that lead on
_DEPTH = np.pi / 4.0  # mean distance of the visible surface from the axis, half widths
_MAX_SIDE = 0.7  # step aside at most, half widths
_MAX_TURN = np.cos(np.radians(40.0))  # cosine of the turn in a step at most
_FEWEST = 5  # points of a step at least
_SHARE = 0.3  # of the points of the steps before, the same
_LASTING = 0.2  # weight of the last one of these
_MAX_STEPS = 400
_ROUNDS = 2  # of a step, each across the way that the last one found
_LONGER = 1.5  # half widths: shorter ways on are the end's own


def follow_ends(
    strands: Sequence[Strand], flat: NDArray[np.bool_], ground: Ground
) -> tuple[list[Strand], Ground]:
    """Return strands whose free ends go on where points do that lie on no strand, and ground with these.

    Parameters
    ----------
    strands : sequence of Strand
    flat : (K,) ndarray of bool
        Strands in which wires lie side by side, which stay as they are.
    ground : Ground
    """
    clouds = [*ground.clouds, *ground.spare]
    points = np.concatenate(clouds)
    centers = np.concatenate([ground.viewpoints, ground.viewpoints])
    to_camera = np.concatenate([center - cloud for cloud, center in zip(clouds, centers, strict=True)])
    to_camera /= np.linalg.norm(to_camera, axis=1, keepdims=True)
    free = np.ones((len(strands), len(points)), dtype=bool)
    for number, strand in enumerate(strands):
        away = _core.find_squared_distances(points, strand.nodes)
        free[np.arange(len(strands)) != number] &= away > (_SURFACE * strand.half_width) ** 2
    longer = []
    for number, strand in enumerate(strands):
        nodes = strand.nodes
        if not strand.closed and not flat[number]:
            own = _Points(points[free[number]], to_camera[free[number]])
            for late in (0, 1):
                if strand.ends[late] is None:
                    nodes = _follow(nodes[:: 1 if late else -1], own, strand.half_width)
                    nodes = nodes[:: 1 if late else -1]
        longer.append(replace(strand, nodes=nodes))
    pairs = zip(longer, strands, strict=True)
    grown = [strand for strand, before in pairs if len(strand.nodes) > len(before.nodes)]
    return longer, ground.add([_claim(own, grown) for own in ground.spare]) if grown else ground


def _claim(points: Array, strands: Sequence[Strand]) -> NDArray[np.bool_]:
    """Tell which points (N, 3) lie on strands."""
    claimed = np.zeros(len(points), dtype=bool)
    for strand in strands:
        away = _core.find_squared_distances(points, strand.nodes)
        claimed |= away < (_SURFACE * strand.half_width) ** 2
    return claimed


@dataclass(frozen=True, eq=False)
class _Points:
    """Points (N, 3), metres, and unit vectors (N, 3) from these to the cameras that saw them."""

    places: Array
    to_camera: Array

    def select(self, chosen: NDArray[np.bool_]) -> _Points:
        return _Points(self.places[chosen], self.to_camera[chosen])

    def cut(self, place: Array, direction: Array, half: float) -> tuple[Array, int]:
        """Return where the axis lies beside a place (M, 3), by each point, and how many points lie aside."""
        offsets = self.places - place
        along = offsets @ direction
        chosen = np.abs(along) < _STEP * half
        aside = offsets[chosen] - along[chosen, None] * direction
        away = np.linalg.norm(aside, axis=1)
        inside = away < _TUBE * half
        facing = self.to_camera[chosen][inside]
        facing = facing - (facing @ direction)[:, None] * direction
        facing /= np.maximum(np.linalg.norm(facing, axis=1, keepdims=True), 1e-9)
        return aside[inside] - _DEPTH * half * facing, int((~inside & (away < _WIDE * half)).sum())


def _follow(nodes: Array, points: _Points, half: float) -> Array:
    """Return nodes whose last one goes on as far as points lead."""
    along = path_length(nodes)
    left = along[-1] - along
    first = int((left <= _BACK * half).argmax())
    before = int((left <= (_BACK + _HEADING) * half).argmax())
    if before == first or left[0] < 2.0 * (_BACK + _HEADING) * half:
        return nodes
    others = _core.find_squared_distances(points.places, nodes[: before + 1]) > (_SURFACE * half) ** 2
    heading = nodes[first] - nodes[before]
    heading /= max(float(np.linalg.norm(heading)), 1e-12)
    here, _ = points.cut(nodes[first], heading, half)
    usual = float(len(here))
    points = points.select(others & ((points.places - nodes[first]) @ heading > -half))
    way = [nodes[before], nodes[first]]
    for _ in range(_MAX_STEPS):
        found = _step(way, heading, points, half, max(_FEWEST, _SHARE * usual))
        if found is None:
            break
        place, heading, count = found
        usual += _LASTING * (count - usual)
        way.append(place)
    if (len(way) - 2) * _STEP * half < left[first] + _LONGER * half:
        return nodes
    return np.concatenate([nodes[:first], way[1:]])


def _step(
    way: Sequence[Array], heading: Array, points: _Points, half: float, fewest: float
) -> tuple[Array, Array, int] | None:
    """Return the next place of a way, the heading there and how many points lead there; None at the end."""
    place, turned, count = way[-1] + _STEP * half * heading, heading, 0
    for _ in range(_ROUNDS):
        axes, beside = points.cut(place, turned, half)
        count = len(axes)
        if count < fewest or beside > _MAX_WIDE * count:
            return None
        aside = axes.mean(axis=0)
        if np.linalg.norm(aside) > _MAX_SIDE * half:
            return None
        onward = place + aside - way[-2]
        turned = heading + onward / max(float(np.linalg.norm(onward)), 1e-12)
        turned /= max(float(np.linalg.norm(turned)), 1e-12)
        if turned @ heading < _MAX_TURN:
            return None
        ahead = place + aside - way[-1]
        place = way[-1] + _STEP * half * ahead / max(float(np.linalg.norm(ahead)), 1e-12)
    return place, turned, count
