"""Curves over gaps: they bend least, keep out of free space, and may have a known length."""

from __future__ import annotations

import numpy as np

import strand._core as _core
from strand.geometry.polyline import bridge, path_length
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.support.checks import Array

DIRECTION_SPAN = 1.5  # radii: stretch over which the direction of an arc's end is taken
BRIDGE_SPACING = 0.4  # radii: distance between a bridge's nodes
LONG_GAP = 3.0  # radii: shorter gaps are bridged by a plain cubic
_REACHES = (0.6, 1.0, 1.5)  # gaps: lengths of the tangents that are tried over long gaps
_MAX_SEEN_THROUGH = 0.3  # share of a bridge that cameras may have seen through
_DIRECTIONS = 16  # sides to which a bow is tried
_MAX_STRETCH = 2.0  # times the plain bridge's length: no bow is longer
_MAX_BEND = 0.4  # curvature times the radius: no bow bends more tightly
_BISECTIONS = 30  # steps that find a bow's height
_ROOM = 1.5  # times the bow's height: how far around it there should be room
_NO_ROOM = 2.0  # cost of each radius of that higher bow where no rope can be


def _measure_curvature(nodes: Array) -> Array:
    """Return the curvature at the inner nodes, 1/m: angle between two steps over their mean length."""
    steps = np.diff(nodes, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    units = steps / np.maximum(lengths, 1e-12)[:, None]
    turns = np.arccos(np.clip((units[1:] * units[:-1]).sum(axis=1), -1.0, 1.0))
    return np.asarray(turns / np.maximum(0.5 * (lengths[1:] + lengths[:-1]), 1e-12))


def price_bridge(nodes: Array, evidence: JoinEvidence) -> float:
    """Return a bridge's bending energy times the radius, plus a price for its length in free space."""
    radius, visibility = evidence.radius, evidence.visibility
    cost = radius * _core.measure_bending(nodes)
    if visibility is not None:
        free = float(visibility.free(nodes, radius).mean() * path_length(nodes)[-1])
        cost += evidence.config.seen_through * free / radius
    return cost


def is_seen_through(nodes: Array, evidence: JoinEvidence) -> bool:
    """Tell whether cameras saw through too much of a bridge."""
    visibility = evidence.visibility
    return visibility is not None and bool(visibility.free(nodes, evidence.radius).mean() > _MAX_SEEN_THROUGH)


def make_bridge(before: Array, after: Array, evidence: JoinEvidence, length: float | None = None) -> Array:
    """Return (B, 3) nodes of the cubic between two arcs that bends least and avoids free space, metres.

    It leads from the last node of `before` to the first of `after`, both excluded. If it is known to have a
    length, metres, and the cubic is shorter, a bow to one side adds the rest where there is room.
    """
    radius = evidence.radius
    span, spacing = DIRECTION_SPAN * radius, BRIDGE_SPACING * radius
    if length is not None:
        bow = _make_bow(before, after, evidence, length)
        if bow is not None:
            return bow
    plain = bridge(before, after, span, spacing)
    if np.linalg.norm(after[0] - before[-1]) < LONG_GAP * radius:
        return plain
    best, least = plain, np.inf
    for leave in _REACHES:
        for arrive in _REACHES:
            nodes = bridge(before, after, span, spacing, (leave, arrive))
            cost = price_bridge(np.vstack([before[-1:], nodes, after[:1]]), evidence)
            if cost < least - 1e-9:
                best, least = nodes, cost
    return best


def _make_bow(before: Array, after: Array, evidence: JoinEvidence, length: float) -> Array | None:
    """Return nodes of a bridge of a given length; None if it would lie where no rope can be."""
    radius = evidence.radius
    chord = after[0] - before[-1]
    gap, span = float(np.linalg.norm(chord)), DIRECTION_SPAN * radius
    best, least = None, np.inf
    side = np.cross(chord, np.eye(3)[np.abs(chord).argmin()])
    side /= np.linalg.norm(side)
    angle = 2.0 * np.pi / _DIRECTIONS * np.arange(_DIRECTIONS)[:, None]
    aside = np.cos(angle) * side + np.sin(angle) * np.cross(chord / gap, side)
    for leave in _REACHES:
        for arrive in _REACHES:
            cubic = bridge(before, after, span, BRIDGE_SPACING * radius * gap / length, (leave, arrive))
            way = np.vstack([before[-1:], cubic, after[:1]])
            own = float(path_length(way)[-1])
            if own > length or length > _MAX_STRETCH * own:
                continue
            t = np.linspace(0.0, 1.0, len(way))
            # a straight rod with clamped ends buckles like this
            bow = np.sin(np.pi * t) ** 2
            low, high = np.zeros(_DIRECTIONS), np.full(_DIRECTIONS, length)
            for _ in range(_BISECTIONS):
                height = 0.5 * (low + high)
                bowed = way + (height[:, None] * bow)[..., None] * aside[:, None]
                short = np.linalg.norm(np.diff(bowed, axis=1), axis=2).sum(axis=1) < length
                low, high = np.where(short, height, low), np.where(short, high, height)
            room = way + _ROOM * (bowed - way)
            for nodes, farther in zip(bowed, room, strict=True):
                if _measure_curvature(nodes).max() > _MAX_BEND / radius:
                    continue
                if _measure_impossible(nodes, evidence) > _MAX_SEEN_THROUGH:
                    continue
                cost = price_bridge(nodes, evidence)
                cost += _NO_ROOM * _measure_impossible(farther, evidence) * length / radius
                if cost < least - 1e-9:
                    best, least = nodes[1:-1], cost
    return best


def _measure_impossible(nodes: Array, evidence: JoinEvidence) -> float:
    """Return the share of nodes where no rope can be: in free space, or outside the extraction range."""
    bounds, visibility = evidence.prior.bounds, evidence.visibility
    out = np.zeros(len(nodes), dtype=bool)
    if bounds is not None:
        out |= ~bounds.holds(nodes)
    if visibility is not None:
        out |= visibility.free(nodes, evidence.radius)
    return float(out.mean())
