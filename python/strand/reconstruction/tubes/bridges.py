"""The curve over a gap: it bends least, keeps out of free space, and may have a known length."""

from __future__ import annotations

import numpy as np

import strand._core as _core
from strand.geometry.polyline import bridge, path_length
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.support.checks import Array

# gaps shorter than this are bridged by a plain cubic, in radii; over longer ones these lengths of the
# tangents, as parts of the gap, are tried
LONG, _REACHES = 3.0, (0.6, 1.0, 1.5)
# no gap is bridged of which cameras saw through a larger share
_SEEN_THROUGH = 0.3
# a bridge that is to be longer bows to one side, of so many that are tried; it is at most so many times as
# long, bends at most so tightly (times the radius), and its height is found by so many bisections
_DIRECTIONS, _LONGEST, _TIGHTEST, _BISECTIONS = 16, 2.0, 0.4, 30
# it bows where there is room: of a bow so many times as high, each radius where no rope can be costs this
_ROOM, _NOWHERE = 1.5, 2.0


def _curvature(nodes: Array) -> Array:
    """Return the curvature at the inner nodes, 1/m: turns between steps over the lengths they stand for."""
    steps = np.diff(nodes, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = steps / np.maximum(lengths, 1e-12)[:, None]
    turns = np.arccos(np.clip((units[1:] * units[:-1]).sum(axis=1), -1.0, 1.0))
    return np.asarray(turns / np.maximum(0.5 * (lengths[1:] + lengths[:-1]), 1e-12))


def bridge_cost(nodes: Array, evidence: JoinEvidence) -> float:
    """Bending energy of a bridge between two arcs, times the radius, and what it costs to be seen through."""
    radius, visibility = evidence.radius, evidence.visibility
    cost = radius * _core.bending(nodes)
    if visibility is not None:
        free = float(visibility.free(nodes, radius).mean() * path_length(nodes)[-1])
        cost += evidence.config.seen_through * free / radius
    return cost


def seen_through(nodes: Array, evidence: JoinEvidence) -> bool:
    """Tell whether cameras saw through too much of a bridge for it to be rope."""
    visibility = evidence.visibility
    return visibility is not None and bool(visibility.free(nodes, evidence.radius).mean() > _SEEN_THROUGH)


def least_bending(
    before: Array,
    after: Array,
    evidence: JoinEvidence,
    length: float | None = None,
) -> Array:
    """Nodes of the cubic between two arcs that bends least and keeps out of space that cameras saw free.

    Parameters
    ----------
    before, after : (K, 3) ndarray
        Ordered nodes, metres; the bridge goes from the last of `before` to the first of `after`.
    evidence : JoinEvidence
        Bows keep to its prior's bounds.
    length : float, optional
        How long the bridge is known to be, metres. If a cubic is shorter, a bow to one side adds the rest; if
        there is no room for it, the bridge stays shorter.

    Returns
    -------
    (B, 3) ndarray
        The nodes between the two, metres.
    """
    radius = evidence.radius
    span, spacing = 1.5 * radius, 0.4 * radius
    if length is not None:
        bowed = _bowed(before, after, evidence, length)
        if bowed is not None:
            return bowed
    plain = bridge(before, after, span, spacing)
    if np.linalg.norm(after[0] - before[-1]) < LONG * radius:
        return plain
    best, least = plain, np.inf
    for leave in _REACHES:
        for arrive in _REACHES:
            nodes = bridge(before, after, span, spacing, (leave, arrive))
            cost = bridge_cost(np.vstack([before[-1:], nodes, after[:1]]), evidence)
            if cost < least - 1e-9:
                best, least = nodes, cost
    return best


def _bowed(before: Array, after: Array, evidence: JoinEvidence, length: float) -> Array | None:
    """Nodes of a bridge of a given length, or None if it would leave the space that it may be in."""
    radius = evidence.radius
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
                if _nowhere(nodes, evidence) > _SEEN_THROUGH:
                    continue
                cost = bridge_cost(nodes, evidence)
                cost += _NOWHERE * _nowhere(farther, evidence) * length / radius
                if cost < least - 1e-9:
                    best, least = nodes[1:-1], cost
    return best


def _nowhere(nodes: Array, evidence: JoinEvidence) -> float:
    """Return the share of nodes that lie where no rope is: in free space, or outside the bounds."""
    bounds, visibility = evidence.prior.bounds, evidence.visibility
    out = np.zeros(len(nodes), dtype=bool)
    if bounds is not None:
        out |= ~bounds.holds(nodes)
    if visibility is not None:
        out |= visibility.free(nodes, evidence.radius)
    return float(out.mean())
