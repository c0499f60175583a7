"""The curve over a gap: it bends least, keeps out of what was seen empty, and may have a known length."""

from __future__ import annotations

import numpy as np

from strand import _core
from strand.config import Linking
from strand.strings import bridge
from strand.topology import path_length
from strand.view import Array
from strand.visibility import Sight

# gaps shorter than this are bridged by a plain cubic, in radii; over longer ones the tangents' lengths are
# tried
LONG, _REACHES = 3.0, (0.6, 1.0, 1.5)
# no gap is bridged of which cameras saw through a larger share
SEEN_THROUGH = 0.3
# a bridge that is to be longer leaves the straight way in one of so many directions; it is at most so much
# longer, bends at most so tightly (times the radius), and its length is found by so many bisections
_DIRECTIONS, _LONGEST, _TIGHTEST, _BISECTIONS = 16, 2.0, 0.4, 30
# it goes where there is room: so much farther aside, each radius where no string can be costs this
_ROOM, _NOWHERE = 1.5, 2.0


def _curvature(nodes: Array) -> Array:
    """Return the curvature at the inner nodes, 1/m: turns between steps over the lengths they stand for."""
    steps = np.diff(nodes, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = steps / np.maximum(lengths, 1e-12)[:, None]
    turns = np.arccos(np.clip((units[1:] * units[:-1]).sum(axis=1), -1.0, 1.0))
    return np.asarray(turns / np.maximum(0.5 * (lengths[1:] + lengths[:-1]), 1e-12))


def bridge_cost(nodes: Array, radius: float, sight: Sight | None, config: Linking) -> float:
    """Bending energy of a bridge between two arcs, times the radius, and what it costs to be seen through."""
    cost = radius * _core.bending(nodes)
    if sight is not None:
        cost += (
            config.seen_through * float(sight.free(nodes, radius).mean() * path_length(nodes)[-1]) / radius
        )
    return cost


def least_bending(
    before: Array,
    after: Array,
    radius: float,
    sight: Sight | None,
    config: Linking,
    length: float | None = None,
    bounds: tuple[Array, Array] | None = None,
) -> Array:
    """Nodes of the cubic between two arcs that bends least and keeps to space that no camera saw to be empty.

    Parameters
    ----------
    before, after : (K, 3) ndarray
        Ordered nodes, metres; the bridge goes from the last of `before` to the first of `after`.
    radius : float
        The strings' radius, metres.
    sight : Sight, optional
        What the views saw.
    config : Linking
    length : float, optional
        How long the bridge is known to be, metres. What a cubic lacks, a bow to one side adds; if there is no
        room for it, the bridge stays shorter.
    bounds : pair of (3,) ndarray, optional
        Low and high corner of a box that holds the string, metres: bows keep to it.

    Returns
    -------
    (B, 3) ndarray
        The nodes between the two, metres.
    """
    span, spacing = 1.5 * radius, 0.4 * radius
    if length is not None:
        bowed = _bowed(before, after, radius, sight, config, length, bounds)
        if bowed is not None:
            return bowed
    plain = bridge(before, after, span, spacing)
    if np.linalg.norm(after[0] - before[-1]) < LONG * radius:
        return plain
    best, least = plain, np.inf
    for leave in _REACHES:
        for arrive in _REACHES:
            nodes = bridge(before, after, span, spacing, (leave, arrive))
            cost = bridge_cost(np.vstack([before[-1:], nodes, after[:1]]), radius, sight, config)
            if cost < least - 1e-9:
                best, least = nodes, cost
    return best


def _bowed(
    before: Array,
    after: Array,
    radius: float,
    sight: Sight | None,
    config: Linking,
    length: float,
    bounds: tuple[Array, Array] | None,
) -> Array | None:
    """Nodes of a bridge of a given length, or None if it would leave the space that it may be in."""
    chord = after[0] - before[-1]
    gap = float(np.linalg.norm(chord))
    best, least = None, np.inf
    side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= np.linalg.norm(side)
    angle = 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)[:, None]
    aside = np.cos(angle) * side + np.sin(angle) * np.cross(chord / gap, side)
    for leave in _REACHES:
        for arrive in _REACHES:
            cubic = bridge(before, after, 1.5 * radius, 0.4 * radius * gap / length, (leave, arrive))
            way = np.vstack([before[-1:], cubic, after[:1]])
            own = float(path_length(way)[-1])
            if own > length or length > _LONGEST * own:
                continue
            t = np.linspace(0.0, 1.0, len(way))
            # how a straight rod buckles whose ends are held
            bow = np.sin(np.pi * t) ** 2
            # no bow is higher than long
            low, high = np.zeros(_DIRECTIONS), np.full(_DIRECTIONS, length)
            for _ in range(_BISECTIONS):
                height = 0.5 * (low + high)
                bowed = way + (height[:, None] * bow)[..., None] * aside[:, None]
                short = np.linalg.norm(np.diff(bowed, axis=1), axis=2).sum(axis=1) < length
                low, high = np.where(short, height, low), np.where(short, high, height)
            room = way + _ROOM * (bowed - way)
            for nodes, farther in zip(bowed, room, strict=True):
                if _curvature(nodes).max() > _TIGHTEST / radius:
                    continue
                if _nowhere(nodes, radius, sight, bounds) > SEEN_THROUGH:
                    continue
                cost = bridge_cost(nodes, radius, sight, config)
                cost += _NOWHERE * _nowhere(farther, radius, sight, bounds) * length / radius
                if cost < least - 1e-9:
                    best, least = nodes[1:-1], cost
    return best


def _nowhere(nodes: Array, radius: float, sight: Sight | None, bounds: tuple[Array, Array] | None) -> float:
    """Return the share of nodes that lie where no string is: seen to be empty, or outside the bounds."""
    out = np.zeros(len(nodes), dtype=bool)
    if bounds is not None:
        out |= ((nodes < bounds[0]) | (nodes > bounds[1])).any(axis=1)
    if sight is not None:
        out |= sight.free(nodes, radius)
    return float(out.mean())
