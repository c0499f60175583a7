"""What a hypothesis costs: what it leaves unexplained, and what speaks against the ropes that it makes."""

from __future__ import annotations

import numpy as np

import strand._core as _core
from strand._core import TubeFit
from strand.geometry.polyline import find_runs, path_length
from strand.reconstruction.courses import Chains
from strand.reconstruction.evidence.join_evidence import JoinEvidence
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.second_look import is_phantom, unexplained
from strand.reconstruction.tubes.tube_ends import extents

# with b the curvature times the radius, each radius of rope costs _BENDING (b^2 + _KINK max(b - _SHARP, 0))
_BENDING, _SHARP, _KINK = 1.5, 0.6, 4.0
# each rope costs this, and each radius of rope that was seen through or that is in another strand's place
_ROPE, _FREE, _INSIDE = 10.0, 2.0, 4.0
# a hypothesis with a stretch of rope that cameras saw through costs this much more
_GONE = 20.0
# each rope more or less than there are; each radius that a known length is missed by, at most a rope
_COUNT, _LENGTH = 30.0, 2.0
# two strands are 2 radii apart; nearer than this is no noise
_CONTACT = 1.5


def explanation_cost(fit: TubeFit, visibility: Visibility | None) -> float:
    """Cost of an explanation of the points, in radii of rope.

    The length of rope that the unexplained points would make, the bending energy, a price for each rope, and
    for each stretch of rope where there can be none.

    Parameters
    ----------
    fit : TubeFit
    visibility : Visibility, optional
        What the views saw.

    Returns
    -------
    float
    """
    r = fit.radius(0)
    parts = [part for part in extents(fit, exclusive=False) if part is not None]
    if not parts:
        return float("inf")
    lost = unexplained(fit)
    each = (~lost).sum() * r / max(sum(part.length for part in parts), r)
    cost = float(lost.sum() / max(each, 1.0)) + _ROPE * len(fit.curves)
    spacing = 0.25
    centres, places, number = [], [], []
    for k, part in enumerate(parts):
        s = part.spaced(spacing * r)
        position, _, curvature = part.at(s)
        bend = np.minimum(np.linalg.norm(curvature, axis=1) * r, 1.5)
        cost += _BENDING * spacing * float((bend**2 + _KINK * np.maximum(bend - _SHARP, 0.0)).sum())
        if visibility is not None:
            free = visibility.free(position, r)
            cost += _FREE * spacing * float(free.sum())
            cost += _GONE * sum(is_phantom(stretch, len(s), spacing) for stretch in find_runs(free))
        centres.append(position[::2])
        places.append(s[::2])
        number.append(np.full(len(s[::2]), k))
    centre, place, which = np.concatenate(centres), np.concatenate(places), np.concatenate(number)
    near = _core.overlapping(centre, which, place, _CONTACT * r, 5.0 * r)
    if visibility is not None:
        # where nothing was seen, bridges know nothing of each other's height
        near &= ~visibility.occluded(centre, r)
    return cost + _INSIDE * 2.0 * spacing * float(near.sum())


def contradiction_cost(chains: Chains, evidence: JoinEvidence) -> float:
    """Return what chains cost that contradict what is known of the ropes beforehand."""
    prior = evidence.prior
    cost = 0.0 if prior.ropes is None else _COUNT * abs(len(chains) - prior.ropes)
    if evidence.config.rings == "always":
        cost += _COUNT * sum(not closed for _, closed in chains)
    if prior.lengths:
        lengths = [float(path_length(nodes)[-1]) for nodes, _ in chains]
        for length, true in zip(lengths, prior.expected(lengths), strict=True):
            cost += min(_LENGTH * prior.length_excess(length, true, evidence.radius), _COUNT)
    return cost
