"""Ropes as capsules within a given error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from strand.geometry.line import Line
from strand.support.checks import Array, check_positive, freeze_array

_SAMPLING_SHARE = 0.05  # of the error: a smooth curve may be that far from the places that stand for it
_MIN_ERROR = 1e-3  # radii; below, thousands of capsules would be needed


@dataclass(frozen=True, eq=False)
class Capsules:
    """Capsules along ropes, in order: all within `radius` of the segments from `start` to `stop`.

    Attributes
    ----------
    start, stop : (K, 3) ndarray
        Ends of the axes, on the centrelines, world frame, metres.
    radius : (K,) ndarray
        Radius of the rope, metres.
    chain : (K,) ndarray of int
        Number of the rope in `Model.chains`.
    s : (K, 2) ndarray
        Arc lengths of `start` and `stop` on the rope, metres.
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
        """(K,) Lengths of the axes, without the round ends, metres."""
        return np.asarray(np.linalg.norm(self.stop - self.start, axis=1))

    @property
    def poses(self) -> Array:
        """(K, 4, 4) Capsule-to-world poses: origin in the middle of the axis, z along it."""
        along = (self.stop - self.start) / self.lengths[:, None]
        # any direction across will do; this world axis is never along the capsule
        least = np.eye(3)[np.abs(along).argmin(axis=1)]
        across = np.cross(along, least)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        poses = np.tile(np.eye(4), (len(self), 1, 1))
        poses[:, :3, :3] = np.stack([across, np.cross(along, across), along], axis=2)
        poses[:, :3, 3] = 0.5 * (self.start + self.stop)
        return poses


def make_capsules(chains: Sequence[Line], error: float) -> Capsules:
    """Return capsules along chains, see `strand.Model.capsules`."""
    smallest = max((chain.radius for chain in chains), default=0.0) * _MIN_ERROR
    if check_positive("error", error) < smallest:
        raise ValueError(f"error: expected at least a thousandth of the radius, {smallest:g} m, got {error}")
    starts, stops, radii, numbers, arcs = [np.empty((0, 3))], [np.empty((0, 3))], [], [], [np.empty((0, 2))]
    for number, chain in enumerate(chains):
        s, places = _sample(chain, error)
        kept = _choose_corners(places, (1.0 - 2.0 * _SAMPLING_SHARE) * error)
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


def _sample(chain: Line, error: float) -> tuple[Array, Array]:
    """Return arc lengths and places; the segments between them stand for the centreline."""
    if chain.curve is None:
        if not chain.closed:
            return chain.arc_length, chain.points
        return np.append(chain.arc_length, chain.length), np.vstack([chain.points, chain.points[:1]])
    # a circle leaves its chord by curvature * step^2 / 8; between nodes curvature may be twice as large
    bend = 2.0 * float(np.linalg.norm(chain.curve.at(chain.arc_length)[2], axis=1).max())
    step = chain.length / (len(chain.points) - 1)
    if bend > 0:
        step = min(step, math.sqrt(8.0 * _SAMPLING_SHARE * error / bend))
    s = np.linspace(0.0, chain.length, math.ceil(chain.length / step) + 1)
    return s, chain.at(s)


def _choose_corners(places: Array, error: float) -> NDArray[np.int64]:
    """Return the numbers of places whose segments follow all others within the error, chosen greedily."""
    kept, last = [0], len(places) - 1
    while kept[-1] < last:
        here = kept[-1]
        reach, beyond, stride = here + 1, last + 1, 2
        while here + stride <= last:
            if not _is_straight(places[here : here + stride + 1], error):
                beyond = here + stride
                break
            reach = here + stride
            stride *= 2
        # the stretch to `reach` is straight; that to `beyond` is not, or does not exist
        while beyond - reach > 1:
            middle = (reach + beyond) // 2
            if _is_straight(places[here : middle + 1], error):
                reach = middle
            else:
                beyond = middle
        kept.append(reach)
    return np.array(kept)


def _is_straight(places: Array, error: float) -> bool:
    """Tell whether all places are within the error of the segment from the first to the last."""
    line = places[-1] - places[0]
    square = float(line @ line)
    if square == 0:  # once around a ring
        return False
    aside = places - places[0]
    aside = aside - np.clip(aside @ line / square, 0.0, 1.0)[:, None] * line
    return float((aside * aside).sum(axis=1).max()) <= error * error
