"""Doubt answers of tubes: list the evidence against them, and weigh it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.geometry.polyline import path_length
from strand.reconstruction.evidence.confidence import MIN_DOUBT, SCALE, USUAL_NOISE, doubt_margin
from strand.reconstruction.tubes.hypotheses import Hypothesis, ScoredHypothesis, measure_prior_cost
from strand.reconstruction.tubes.joins import ByClass, run_through
from strand.reconstruction.tubes.tube_ends import find_extents
from strand.ropes.doubt import Doubt, Join
from strand.support.checks import Array, round_to_millimeters

# Amounts are doubts as in `Doubt.amount`. They were set on scenes drawn at random.
_END = 0.4  # per reason to doubt an end
_MAX_UNSEEN = 1.75  # radii beyond an end that no camera needs to see
_MAX_MOVE = 0.75  # radii that an end may move with points that another strand explains too
_INSIDE = (0.5, 2.5)  # radii: stretch inside an end that needs points
_MIN_DENSITY = 0.4  # share of the rope's points per length that this stretch needs
_DROPPED = 0.15  # per radius of a segment that became part of no rope, and for one more radius
_NOISE = 6.0  # per radius of noise beyond `USUAL_NOISE`
_STRAY_POINTS = 10.0  # per share of points that are missing to the usual share
_USUAL_SHARE = 0.92  # of the points that lie on ropes


def find_tube_doubts(
    by_class: ByClass,
    joins: Sequence[Join],
    parts: Sequence[Curve | None],
    fit: TubeFit,
    unseen: Sequence[tuple[float, float] | None],
) -> tuple[Doubt, ...]:
    """Return the doubts about an answer, the greatest first.

    Reasons for doubt are joins with small margins, rivals that cost hardly more, and ends beyond which the
    rope may go on unseen. Others are segments or points on no rope, and noise that is wide against the ropes.
    The last is a given number, if an answer that ignores it explains the points better.

    Parameters
    ----------
    by_class : sequence of sequence of ScoredHypothesis
    joins : sequence of Join
        Joins of the best hypotheses.
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that is rope.
    fit : TubeFit
        The last fit.
    unseen : sequence of ((float, float) or None)
        From `measure_unseen`, for these parts.
    """
    found = [_doubt_join(join) for join in joins]
    for scored in filter(None, by_class):
        found += _doubt_decision(scored, fit.sigma)
    found += _doubt_ends(parts, fit, unseen)
    found.append(doubt_stray_points(float(fit.inlier.mean())))
    found = [doubt for doubt in found if doubt.amount > MIN_DOUBT]
    return tuple(sorted(found, key=lambda doubt: -doubt.amount))


def doubt_stray_points(share: float) -> Doubt:
    """Return the doubt of an answer on whose ropes a share of the points lies."""
    reason = (
        f"only {share:.0%} of the points lie on the ropes found; is the radius right, and do bounds exclude "
        "everything else?"
    )
    amount = _STRAY_POINTS * max(_USUAL_SHARE - share, 0.0)
    return Doubt("points", amount, "of the ropes found", reason)


def _doubt_join(join: Join) -> Doubt:
    other = (
        "it may end there"
        if join.alternative is None
        else f"it may go on at {round_to_millimeters(join.alternative)}"
    )
    reason = f"{other} (margin {join.margin:.1f})"
    return Doubt("join", doubt_margin(join.margin), "how the rope runs", reason, join.place)


def _doubt_decision(scored: Sequence[ScoredHypothesis], noise: float) -> list[Doubt]:
    """Return doubts about the decision on one class of radius; `noise` is in metres."""
    best = scored[0].hypothesis
    radius = best.radius
    found = []
    for nodes in best.dropped:
        length = float(path_length(nodes)[-1])
        reason = f"a segment of {length * 1e3:.0f} mm became part of no rope"
        amount = _DROPPED * (length / radius + 1.0)
        found.append(Doubt("left out", amount, "what is there", reason, nodes[len(nodes) // 2]))
    wide = noise / radius
    reason = f"noise is {wide:.2f} radii wide"
    amount = _NOISE * max(wide - USUAL_NOISE, 0.0)
    found.append(Doubt("noise", amount, "of details finer than the noise", reason))
    reason = "without it, other ropes would explain the points better"
    amount = measure_prior_cost(scored) / SCALE
    found.append(Doubt("prior", amount, "whether what was given about the ropes is right", reason))
    if len(scored) > 1:
        more = scored[1].cost - scored[0].cost
        amount = float(np.exp(-more / SCALE))
        reason = f"another way to explain the points costs {more:.1f} more"
        place = _locate_difference(best, scored[1].hypothesis)
        found.append(Doubt("rival", amount, "how the ropes run", reason, place))
    return found


def _locate_difference(best: Hypothesis, rival: Hypothesis) -> Array | None:
    """Return a place where one hypothesis joins ends that the other does not."""
    for some, other in ((rival, best), (best, rival)):
        for pair in some.joins:
            a, b = (some.costs.locate_end(end) for end in pair)
            if not run_through(other.chains, a, b, best.radius):
                return np.asarray(0.5 * (a + b))
    return None


def _doubt_ends(
    parts: Sequence[Curve | None], fit: TubeFit, unseen: Sequence[tuple[float, float] | None]
) -> list[Doubt]:
    """Return doubts about ends that few points show, or beyond which no camera saw."""
    found = []
    extents = find_extents(fit, exclusive=False)
    for number, (kept, hidden, whole) in enumerate(zip(parts, unseen, extents, strict=True)):
        if kept is None or hidden is None:
            continue
        r = fit.radius(number)
        curve = Curve.whole(kept.control)
        start, stop = curve.arc_length_at([kept.start, kept.stop])
        s = curve.arc_length_at(fit.parameter[fit.inlier & (fit.curve == number)])
        typical = np.count_nonzero((s > start) & (s < stop)) / max(stop - start, r)
        others = (np.inf, np.inf) if whole is None else curve.arc_length_at([whole.start, whole.stop])
        for late, end, other in ((False, start, others[0]), (True, stop, others[1])):
            inside = end - s if late else s - end
            seen = np.count_nonzero((inside > _INSIDE[0] * r) & (inside < _INSIDE[1] * r))
            few = seen < _MIN_DENSITY * typical * (_INSIDE[1] - _INSIDE[0]) * r
            place = kept.place_at([kept.length if late else 0.0])[0]
            reasons = []
            if few or abs(end - other) > _MAX_MOVE * r:
                reasons.append("few points show it")
            if hidden[late] > _MAX_UNSEEN * r:
                reasons.append("it may go on where no camera saw")
            found += [Doubt("end", _END, "where the rope ends", reason, place) for reason in reasons]
    return found
