"""How sure a decision is: margins of joins, ends that could lie elsewhere, confidence of the whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand._core import TubeFit
from strand.assembly import Chains, Judged, forced
from strand.config import Linking
from strand.curve import Curve
from strand.ends import string_parts, unseen_beyond
from strand.model import Chain, Doubt, Join
from strand.topology import path_length
from strand.view import Array
from strand.visibility import Sight

# margins are in the units of the costs; this much is worth a factor of e in the odds
_SCALE = 2.5
# how far beyond an end no camera may have seen, in radii
_UNSEEN = 1.75
# a branch ends at most so far from the side of what it comes from, which is how far counting may miss an end,
# and points at its axis this well; the way between is looked at in such steps; in radii
_MEETS, _STRAIGHT, _LOOK = 1.75, 1.2, 0.25
# an end is in doubt if points that may be another strand's move it this far, in radii
_MOVED = 0.75
# or if this stretch before it, in radii, has less than this share of the string's points for its length
_INSIDE, _FEW = (0.5, 2.5), 0.4
# doubt: without any reason, for each join by its margin, for each end that may be another's or farther on,
# for each radius of what is left out, and for the noise in radii beyond what is narrow
_ALWAYS, _JOINS, _ENDS, _STRAY, _NOISE, _NARROW = 0.01, 0.5, 0.4, 0.15, 6.0, 0.21
# and for the share of the points on strings under what is usual
_ASTRAY, _USUAL_SHARE = 10.0, 0.92
# less is not worth mentioning
_LEAST = 1e-3


def joins_of(
    judged: Sequence[Judged], chains: Sequence[Chain], radius: float, config: Linking
) -> tuple[Join, ...]:
    """Say how certain each join of the best assembly is.

    Parameters
    ----------
    judged : sequence of Judged
        The best first.
    chains : sequence of Chain
        What the best became.
    radius : float
        The strings' radius, metres.
    config : Linking

    Returns
    -------
    tuple of Join
        The least certain first.
    """
    best = judged[0].assembly
    links = best.links
    joins = []
    for pair in best.joins:
        a, b = (links.end(end) for end in pair)
        place = 0.5 * (a + b)
        without, cost = links.matched(config.free_end, [pair])
        rivals = [other.cost for other in judged[1:] if not _run(other.assembly.chains, a, b, radius)]
        margin = min([cost - best.matching_cost, *(rival - judged[0].cost for rival in rivals)])
        partner = next((other for one in without for end, other in (one, one[::-1]) if end == pair[0]), None)
        joins.append(
            Join(
                place,
                tuple(sorted({_nearest(chains, a), _nearest(chains, b)})),
                float(margin),
                None if partner is None else links.end(partner),
            )
        )
    return tuple(sorted(joins, key=lambda join: join.margin))


def _run(made: Chains, a: Array, b: Array, radius: float) -> bool:
    """Tell whether one of several chains runs from one place to another."""
    for nodes, _ in made:
        s = path_length(nodes)
        at_a = s[np.linalg.norm(nodes - a, axis=1) < 2.0 * radius]
        at_b = s[np.linalg.norm(nodes - b, axis=1) < 2.0 * radius]
        most = 1.6 * float(np.linalg.norm(b - a)) + 4.0 * radius
        if len(at_a) and len(at_b) and np.abs(at_a[:, None] - at_b[None]).min() < most:
            return True
    return False


def _nearest(chains: Sequence[Chain], place: Array) -> int:
    return int(np.argmin([np.linalg.norm(chain.points - place, axis=1).min() for chain in chains]))


def doubts(
    ways: Sequence[Sequence[Judged]],
    joins: Sequence[Join],
    parts: Sequence[Curve | None],
    fit: TubeFit,
    sight: Sight,
) -> tuple[Doubt, ...]:
    """Say what speaks against the answer, and how much.

    Joins with small margins, rival explanations that cost hardly more, ends beyond which the string could go
    on unseen, pieces that became part of no string, points on no string, noise that is wide for the strings,
    and what explains the points better but for contradicting what is known of the strings. The weights were
    set on scenes drawn at random.

    Parameters
    ----------
    ways : sequence of sequence of Judged
        For each kind of rope ways to make strings of its pieces, the best first.
    joins : sequence of Join
        Of the best ways.
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that is string; None for closed ones too.
    fit : TubeFit
        The last one.
    sight : Sight
        What the views saw.

    Returns
    -------
    tuple of Doubt
        The greatest first.
    """
    found = [_of_join(join) for join in joins]
    for judged in filter(None, ways):
        found += _of_decision(judged)
    found += _of_ends(parts, fit, sight)
    share = float(fit.inlier.mean())
    reason = (
        f"only {share:.0%} of the points lie on the strings found; is the radius right, and does the "
        "extraction range leave out everything else?"
    )
    found.append(Doubt(_ASTRAY * max(_USUAL_SHARE - share, 0.0), "of the strings found", reason))
    return tuple(sorted((doubt for doubt in found if doubt.amount > _LEAST), key=lambda doubt: -doubt.amount))


def confidence(found: Sequence[Doubt]) -> float:
    """How likely the answer is right: exp(-0.01 - d), where d adds up all doubts."""
    return float(np.exp(-_ALWAYS - sum(doubt.amount for doubt in found)))


def doubt_of_margin(margin: float) -> float:
    """How great a doubt a join of this margin raises."""
    return _JOINS * float(np.exp(-max(margin, 0.0) / _SCALE))


def _of_join(join: Join) -> Doubt:
    other = (
        "it may end there"
        if join.alternative is None
        else f"it may go on at {np.round(join.alternative, 3).tolist()}"
    )
    reason = f"{other} (margin {join.margin:.1f})"
    return Doubt(doubt_of_margin(join.margin), "how the string runs", reason, join.place)


def _of_decision(judged: Sequence[Judged]) -> list[Doubt]:
    """Doubts about the decision on one kind of rope."""
    best = judged[0]
    radius = best.fit.radius(0)
    found = []
    for nodes in best.assembly.left_out:
        length = float(path_length(nodes)[-1])
        reason = f"a piece of {length * 1e3:.0f} mm became part of no string"
        found.append(Doubt(_STRAY * (length / radius + 1.0), "what is there", reason, nodes[len(nodes) // 2]))
    wide = best.fit.sigma / radius
    reason = f"noise is {wide:.2f} radii wide"
    found.append(Doubt(_NOISE * max(wide - _NARROW, 0.0), "of all that is finer than the noise", reason))
    reason = "something else explains the points better"
    found.append(Doubt(forced(judged) / _SCALE, "of what is known of the strings beforehand", reason))
    if len(judged) > 1:
        rival = judged[1]
        more = rival.cost - best.cost
        amount = float(np.exp(-more / _SCALE))
        reason = f"another way to explain the points costs {more:.1f} more"
        found.append(Doubt(amount, "how the strings run", reason, _difference(best, rival)))
    return found


def _difference(best: Judged, rival: Judged) -> Array | None:
    """Return where an explanation joins what the best does not, or the other way round."""
    radius = best.fit.radius(0)
    for some, other in ((rival, best), (best, rival)):
        for pair in some.assembly.joins:
            a, b = (some.assembly.links.end(end) for end in pair)
            if not _run(other.assembly.chains, a, b, radius):
                return np.asarray(0.5 * (a + b))
    return None


def _of_ends(parts: Sequence[Curve | None], fit: TubeFit, sight: Sight) -> list[Doubt]:
    """Doubts about ends: strings may go on where no camera saw, or few points show where they end."""
    found = []
    for number, (kept, whole) in enumerate(zip(parts, string_parts(fit, exclusive=False), strict=True)):
        if kept is None:
            continue
        r = fit.radius(number)
        curve = Curve.whole(kept.control)
        start, stop = curve.arc_length([kept.start, kept.stop])
        s = curve.arc_length(fit.parameter[fit.inlier & (fit.curve == number)])
        usual = np.count_nonzero((s > start) & (s < stop)) / max(stop - start, r)
        others = (np.inf, np.inf) if whole is None else curve.arc_length([whole.start, whole.stop])
        for late, end, other in ((False, start, others[0]), (True, stop, others[1])):
            inside = end - s if late else s - end
            seen = np.count_nonzero((inside > _INSIDE[0] * r) & (inside < _INSIDE[1] * r))
            few = seen < _FEW * usual * (_INSIDE[1] - _INSIDE[0]) * r
            place = kept.at([kept.length if late else 0.0])[0][0]
            if few or abs(end - other) > _MOVED * r:
                found.append(Doubt(_ENDS, "where the string ends", "few points show it", place))
            if unseen_beyond(kept, late, sight, r) > _UNSEEN * r:
                reason = "it may go on where no camera saw"
                found.append(Doubt(_ENDS, "where the string ends", reason, place))
    return found


def branches(chains: Sequence[Chain], sight: Sight | None = None) -> list[tuple[int, int, Array]]:
    """Find ends that run straight into the side of another chain, as no string does that only touches it.

    Parameters
    ----------
    chains : sequence of Chain
    sight : Sight, optional
        What the views saw: an end is none of a branch if they saw through between it and the other chain.

    Returns
    -------
    list of (int, int, (3,) ndarray)
        Number of the chain that ends, of the one it ends on, and where, metres.
    """
    found = []
    for number, chain in enumerate(chains):
        for points in () if chain.closed else (chain.points, chain.points[::-1]):
            r = chain.radius
            out = points[0] - points[min(8, len(points) - 1)]
            out = out / np.linalg.norm(out)
            for other, strand in enumerate(chains):
                if other == number:
                    continue
                meets = strand.radius + _MEETS * r
                ahead = points[0] + np.arange(0.0, meets, _LOOK * r)[:, None] * out
                apart = np.linalg.norm(ahead[:, None] - strand.points[None], axis=2)
                place = int(apart.min(axis=0).argmin())
                inner = 2.0 * r < strand.arc_length[place] < strand.length - 2.0 * r or strand.closed
                if not inner or apart[0].min() >= meets or apart.min() >= _STRAIGHT * r:
                    continue
                nearest = apart.min(axis=1)
                between = ahead[: nearest.argmin()][nearest[: nearest.argmin()] > strand.radius]
                if sight is None or not sight.free(between, r).any():
                    found.append((number, other, strand.points[place]))
    return found
