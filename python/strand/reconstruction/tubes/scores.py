"""Price hypotheses by unexplained points, and by evidence against the ropes that they make."""

from __future__ import annotations

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.geometry.lengths import measure_lengths
from strand.geometry.polyline import find_runs, path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.prior import LENGTH_COST, MAX_LENGTH_COST
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.second_look import find_unexplained, is_phantom
from strand.reconstruction.tubes.tube_ends import find_extents

_SPACING = 0.25  # radii: distance of the places where ropes are priced
# with the bend b = curvature * radius, each radius of rope costs _BENDING (b^2 + _KINK max(b - _SHARP, 0))
_BENDING = 1.5  # cost of each radius of rope with a bend of 1, without the kink's part
_KINK = 4.0  # weight of the bend beyond _SHARP
_SHARP = 0.6  # bend above which a rope is kinked
_MAX_BEND = 1.5  # larger bends count as this
_ROPE = 10.0  # cost of each rope
_FREE = 2.0  # cost of each radius of rope that cameras saw through
_PHANTOM = 20.0  # cost of each stretch of rope that cameras saw through
_OVERLAP = 4.0  # cost of each radius of rope in another strand's place
_MIN_DISTANCE = 1.5  # radii: axes of two strands nearer than this overlap; in contact they are 2 apart
_OWN = 5.0  # radii of arc length: nearer places of the same rope do not overlap
_WRONG_COUNT = 30.0  # cost of each rope above or below the known number


def price_explanation(fit: TubeFit, visibility: Visibility | None) -> float:
    """Return the cost of an explanation of the points, in radii of rope.

    The cost is the length of rope that the unexplained points would make, plus the bending energy. Each rope
    has a price, and so has rope where there can be none.
    """
    r = fit.radius(0)
    parts = [part for part in find_extents(fit, exclusive=False) if part is not None]
    if not parts:
        return float("inf")
    lost = find_unexplained(fit)
    each = (~lost).sum() * r / max(sum(part.length for part in parts), r)
    cost = float(lost.sum() / max(each, 1.0)) + _ROPE * len(fit.curves)
    centers, places, number = [], [], []
    for k, part in enumerate(parts):
        s = part.spaced(_SPACING * r)
        position, _, curvature = part.at(s)
        bend = np.minimum(measure_lengths(curvature) * r, _MAX_BEND)
        cost += _BENDING * _SPACING * float((bend**2 + _KINK * np.maximum(bend - _SHARP, 0.0)).sum())
        if visibility is not None:
            free = visibility.free(position, r)
            cost += _FREE * _SPACING * float(free.sum())
            cost += _PHANTOM * sum(is_phantom(stretch, len(s), _SPACING) for stretch in find_runs(free))
        centers.append(position[::2])
        places.append(s[::2])
        number.append(np.full(len(s[::2]), k))
    center, place, which = np.concatenate(centers), np.concatenate(places), np.concatenate(number)
    near = _core.find_overlaps(center, which, place, _MIN_DISTANCE * r, _OWN * r)
    if visibility is not None:
        # the height of bridges that no camera could see is not known
        near &= ~visibility.occluded(center, r)
    return cost + _OVERLAP * 2.0 * _SPACING * float(near.sum())


def price_contradictions(chains: Chains, evidence: JoinEvidence) -> float:
    """Return the cost of contradictions between chains and the known facts about the ropes."""
    prior = evidence.prior
    cost = 0.0 if prior.ropes is None else _WRONG_COUNT * abs(len(chains) - prior.ropes)
    if evidence.config.rings == "always":
        cost += _WRONG_COUNT * sum(not closed for _, closed in chains)
    if prior.lengths:
        lengths = [float(path_length(nodes)[-1]) for nodes, _ in chains]
        for length, true in zip(lengths, prior.match_lengths(lengths), strict=True):
            cost += min(LENGTH_COST * prior.measure_excess(length, true, evidence.radius), MAX_LENGTH_COST)
    return cost
