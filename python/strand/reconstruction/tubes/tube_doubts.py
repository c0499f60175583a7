"""What speaks against an answer of the default method, and how much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import TubeFit
from strand.geometry.curve import Curve
from strand.geometry.polyline import path_length
from strand.reconstruction.evidence.confidence import SCALE, doubt_of_margin
from strand.reconstruction.evidence.visibility import Visibility
from strand.reconstruction.tubes.hypotheses import ScoredHypothesis, without_prior
from strand.reconstruction.tubes.joins import ByClass, runs_through
from strand.reconstruction.tubes.tube_ends import extents, unseen_beyond
from strand.ropes.doubt import Doubt, Join
from strand.support.checks import Array, round_to_millimeters

# how far beyond an end no camera may have seen, in radii
_UNSEEN = 1.75
# an end is in doubt if points that may be another strand's move it this far, in radii
_MOVED = 0.75
# or if this stretch before it, in radii, has less than this share of the rope's points for its length
_INSIDE, _FEW = (0.5, 2.5), 0.4
# doubt for each end that may be another's or farther on, for each radius of what is left out, and for the
# noise in radii beyond what is narrow
_ENDS, _STRAY, _NOISE, _NARROW = 0.4, 0.15, 6.0, 0.21
# and for the share of the points on ropes under what is usual
_ASTRAY, _USUAL_SHARE = 10.0, 0.92
# less is not worth mentioning
_LEAST = 1e-3


def doubts(
    by_class: ByClass,
    joins: Sequence[Join],
    parts: Sequence[Curve | None],
    fit: TubeFit,
    visibility: Visibility,
) -> tuple[Doubt, ...]:
    """Say what speaks against the answer, and how much.

    Joins with small margins, rival hypotheses that cost hardly more, ends beyond which the rope could go on
    unseen, segments that became part of no rope, points on no rope, noise that is wide against the ropes, and
    hypotheses that would explain the points better if less were known of the ropes beforehand. The weights
    were set on scenes drawn at random.

    Parameters
    ----------
    by_class : sequence of sequence of ScoredHypothesis
        For each class of radius the hypotheses about its arcs, the best first.
    joins : sequence of Join
        Of the best ones.
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that is rope; None for closed ones too.
    fit : TubeFit
        The last one.
    visibility : Visibility
        What the views saw.

    Returns
    -------
    tuple of Doubt
        The greatest first.
    """
    found = [_of_join(join) for join in joins]
    for scored in filter(None, by_class):
        found += _of_decision(scored)
    found += _of_ends(parts, fit, visibility)
    share = float(fit.inlier.mean())
    reason = (
        f"only {share:.0%} of the points lie on the ropes found; is the radius right, and does the "
        "extraction range leave out everything else?"
    )
    found.append(Doubt("points", _ASTRAY * max(_USUAL_SHARE - share, 0.0), "of the ropes found", reason))
    return tuple(sorted((doubt for doubt in found if doubt.amount > _LEAST), key=lambda doubt: -doubt.amount))


def _of_join(join: Join) -> Doubt:
    other = (
        "it may end there"
        if join.alternative is None
        else f"it may go on at {round_to_millimeters(join.alternative)}"
    )
    reason = f"{other} (margin {join.margin:.1f})"
    return Doubt("join", doubt_of_margin(join.margin), "how the rope runs", reason, join.place)


def _of_decision(scored: Sequence[ScoredHypothesis]) -> list[Doubt]:
    """Doubts about the decision on one class of radius."""
    best = scored[0]
    radius = best.fit.radius(0)
    found = []
    for nodes in best.hypothesis.left_out:
        length = float(path_length(nodes)[-1])
        reason = f"a segment of {length * 1e3:.0f} mm became part of no rope"
        amount = _STRAY * (length / radius + 1.0)
        found.append(Doubt("left out", amount, "what is there", reason, nodes[len(nodes) // 2]))
    wide = best.fit.sigma / radius
    reason = f"noise is {wide:.2f} radii wide"
    amount = _NOISE * max(wide - _NARROW, 0.0)
    found.append(Doubt("noise", amount, "of all that is finer than the noise", reason))
    reason = "something else explains the points better"
    amount = without_prior(scored) / SCALE
    found.append(Doubt("prior", amount, "of what is known of the ropes beforehand", reason))
    if len(scored) > 1:
        rival = scored[1]
        more = rival.cost - best.cost
        amount = float(np.exp(-more / SCALE))
        reason = f"another way to explain the points costs {more:.1f} more"
        found.append(Doubt("rival", amount, "how the ropes run", reason, _difference(best, rival)))
    return found


def _difference(best: ScoredHypothesis, rival: ScoredHypothesis) -> Array | None:
    """Return where one hypothesis joins what the other does not."""
    radius = best.fit.radius(0)
    for some, other in ((rival, best), (best, rival)):
        for pair in some.hypothesis.joins:
            a, b = (some.hypothesis.costs.end(end) for end in pair)
            if not runs_through(other.hypothesis.chains, a, b, radius):
                return np.asarray(0.5 * (a + b))
    return None


def _of_ends(parts: Sequence[Curve | None], fit: TubeFit, visibility: Visibility) -> list[Doubt]:
    """Doubts about ends: ropes may go on where no camera saw, or few points show where they end."""
    found = []
    for number, (kept, whole) in enumerate(zip(parts, extents(fit, exclusive=False), strict=True)):
        if kept is None:
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
            few = seen < _FEW * typical * (_INSIDE[1] - _INSIDE[0]) * r
            place = kept.at([kept.length if late else 0.0])[0][0]
            if few or abs(end - other) > _MOVED * r:
                found.append(Doubt("end", _ENDS, "where the rope ends", "few points show it", place))
            if unseen_beyond(kept, late, visibility, r) > _UNSEEN * r:
                reason = "it may go on where no camera saw"
                found.append(Doubt("end", _ENDS, "where the rope ends", reason, place))
    return found
