"""Ropes as capsules that follow their tubes within a stated error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.geometry.line import Line
from strand.support.checks import Array, check_positive, freeze_array

# of the error: how far a smooth curve may be from the places on it that stand for it
_SAMPLING = 0.05
# errors below this share of the radius would take thousands of capsules
_LEAST = 1e-3


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules along ropes, in order; what lies within `radius` of the line from `start` to `stop`.

    Attributes
    ----------
    start, stop : (K, 3) ndarray
        Ends of the axes, world frame, metres. They are places of the centrelines.
    radius : (K,) ndarray
        Metres: the rope's.
    chain : (K,) ndarray of int
        The number of the rope in `Model.chains`.
    s : (K, 2) ndarray
        Arc lengths of `start` and `stop` on that rope, metres.
    """

    start: Array
    stop: Array
    radius: Array
    chain: NDArray[np.int64]
    s: Array

    def __post_init__(self) -> None:
        for name in ("start", "stop", "radius", "chain", "s"):
            object.__setattr__(self, name, freeze_array(getattr(self, name)))

    def __len__(self) -> int:
        return len(self.radius)

    def __repr__(self) -> str:
        return f"Capsules({len(self)} of {len(np.unique(self.chain))} ropes)"

    @property
    def lengths(self) -> Array:
        """(K,) Lengths of the axes, metres: without the round ends."""
        return np.asarray(np.linalg.norm(self.stop - self.start, axis=1))

    @property
    def poses(self) -> Array:
        """(K, 4, 4) Frames in the world frame: origin in the middle of the axis, z along it."""
        along = (self.stop - self.start) / self.lengths[:, None]
        # any direction across will do; this one is never along the axis
        least = np.eye(3)[np.abs(along).argmin(axis=1)]
        across = np.cross(along, least)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        poses = np.tile(np.eye(4), (len(self), 1, 1))
        poses[:, :3, :3] = np.stack([across, np.cross(along, across), along], axis=2)
        poses[:, :3, 3] = 0.5 * (self.start + self.stop)
        return poses


def make_capsules(chains: Sequence[Line], error: float) -> Capsules:
    """Return capsules along chains, see `strand.Model.capsules`.

    Parameters
    ----------
    chains : sequence of Line
    error : float
        How far the axes may be from the centrelines, metres.
    """
    smallest = max((chain.radius for chain in chains), default=0.0) * _LEAST
    if check_positive("error", error) < smallest:
        raise ValueError(f"error: expected at least a thousandth of the radius, {smallest:g} m, got {error}")
    starts, stops, radii, numbers, arcs = [np.empty((0, 3))], [np.empty((0, 3))], [], [], [np.empty((0, 2))]
    for number, chain in enumerate(chains):
        s, places = _places(chain, error)
        kept = _corners(places, (1.0 - 2.0 * _SAMPLING) * error)
        starts.append(places[kept[:-1]])
        stops.append(places[kept[1:]])
        radii += [chain.radius] * (len(kept) - 1)
        numbers += [number] * (len(kept) - 1)
        arcs.append(np.stack([s[kept[:-1]], s[kept[1:]]], axis=1))
    return Capsules(
        np.concatenate(starts),
        np.concatenate(stops),
        np.array(radii, dtype=np.float64),
        np.array(numbers, dtype=np.int64),
        np.concatenate(arcs),
    )


def _places(chain: Line, error: float) -> tuple[Array, Array]:
    """Return arc lengths and places; lines between them stand for the centreline."""
    if chain.curve is None:
        if not chain.closed:
            return chain.arc_length, chain.points
        return np.append(chain.arc_length, chain.length), np.vstack([chain.points, chain.points[:1]])
    # a circle is curvature * step^2 / 8 away from its chord; between nodes curvature may be twice theirs
    bend = 2.0 * float(np.linalg.norm(chain.curve.at(chain.arc_length)[2], axis=1).max())
    step = chain.length / (len(chain.points) - 1)
    if bend > 0:
        step = min(step, math.sqrt(8.0 * _SAMPLING * error / bend))
    s = np.linspace(0.0, chain.length, math.ceil(chain.length / step) + 1)
    return s, chain.at(s)


def _corners(places: Array, error: float) -> NDArray[np.int64]:
    """Numbers of places between which straight lines follow all others within the error, greedily."""
    kept, last = [0], len(places) - 1
    while kept[-1] < last:
        here = kept[-1]
        reach, beyond, stride = here + 1, last + 1, 2
        while here + stride <= last:
            if not _straight(places[here : here + stride + 1], error):
                beyond = here + stride
                break
            reach = here + stride
            stride *= 2
        # the way to `reach` is straight, that to `beyond` is not, or there is none
        while beyond - reach > 1:
            middle = (reach + beyond) // 2
            if _straight(places[here : middle + 1], error):
                reach = middle
            else:
                beyond = middle
        kept.append(reach)
    return np.array(kept)


def _straight(places: Array, error: float) -> bool:
    """Whether the line from the first place to the last one is within the error of all between them."""
    line = places[-1] - places[0]
    square = float(line @ line)
    if square == 0:  # round a ring
        return False
    aside = places - places[0]
    aside = aside - np.clip(aside @ line / square, 0.0, 1.0)[:, None] * line
    return float((aside * aside).sum(axis=1).max()) <= error * error
