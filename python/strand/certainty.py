"""How sure a decision is: margins of joins, ends that could lie elsewhere, confidence of the whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.assembly import Chains, Judged, forced
from strand.config import Linking
from strand.curve import Curve
from strand.ends import string_parts
from strand.model import Chain, Join
from strand.topology import path_length
from strand.tubefit import TubeFit
from strand.view import Array
from strand.visibility import Sight

# margins are in the units of the costs; this much is worth a factor of e in the odds
_SCALE = 2.5
# places beyond an end that would have been seen if the string went on, in radii
_BEYOND = (1.5, 2.5)
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


def confidence(
    judged: Sequence[Judged],
    joins: Sequence[Join],
    chains: Sequence[Chain],
    parts: Sequence[Curve | None],
    fit: TubeFit,
    sight: Sight,
) -> float:
    """Say how likely it is that strings run as the best explanation has them.

    exp(-d), where d adds up what raises doubt: joins with small margins, a rival explanation that costs
    hardly more, ends beyond which the string could go on unseen, pieces that became part of no string, noise
    that is wide for the strings, and what explains the points better but for contradicting what is known of
    the strings. The weights were set on scenes drawn at random.

    Parameters
    ----------
    judged : sequence of Judged
        The best first.
    joins : sequence of Join
        Of the best.
    chains : sequence of Chain
        What the best became.
    parts : sequence of (Curve or None)
        The stretch of each fitted curve that is string; None for closed ones too.
    fit : TubeFit
        The last one.
    sight : Sight
        What the views saw.

    Returns
    -------
    float
        From 0 to 1.
    """
    best = judged[0]
    radius = best.fit.radius(0)
    doubt = _ALWAYS + _JOINS * sum(float(np.exp(-max(join.margin, 0.0) / _SCALE)) for join in joins)
    if len(judged) > 1:
        doubt += float(np.exp(-(judged[1].cost - best.cost) / _SCALE))
    doubt += _ENDS * sum(_could_go_on(chain, sight, radius) for chain in chains)
    doubt += _ENDS * _vague_ends(parts, fit)
    doubt += _STRAY * sum(length / radius + 1.0 for length in best.assembly.left_out)
    doubt += _NOISE * max(best.fit.sigma / radius - _NARROW, 0.0)
    doubt += forced(judged) / _SCALE
    return float(np.exp(-doubt))


def _vague_ends(parts: Sequence[Curve | None], fit: TubeFit) -> int:
    """Count the ends that few points show, or that lie elsewhere if points count that may be another's."""
    count = 0
    for number, (kept, whole) in enumerate(zip(parts, string_parts(fit, exclusive=False), strict=True)):
        if kept is None or whole is None:
            continue
        r = fit.radius(number)
        curve = Curve.whole(kept.control)
        start, stop, *others = curve.arc_length([kept.start, kept.stop, whole.start, whole.stop])
        s = curve.arc_length(fit.parameter[fit.inlier & (fit.curve == number)])
        usual = np.count_nonzero((s > start) & (s < stop)) / max(stop - start, r)
        for end, other, inwards in ((start, others[0], 1.0), (stop, others[1], -1.0)):
            inside = (s - end) * inwards
            seen = np.count_nonzero((inside > _INSIDE[0] * r) & (inside < _INSIDE[1] * r))
            few = seen < _FEW * usual * (_INSIDE[1] - _INSIDE[0]) * r
            count += bool(few or abs(end - other) > _MOVED * r)
    return count


def _could_go_on(chain: Chain, sight: Sight, radius: float) -> int:
    """Count the ends beyond which no camera would have seen more of the string."""
    if chain.closed:
        return 0
    count = 0
    for points in (chain.points, chain.points[::-1]):
        out = points[0] - points[min(4, len(points) - 1)]
        out = out / np.linalg.norm(out)
        count += bool(sight.hidden(points[0] + radius * np.array(_BEYOND)[:, None] * out, radius).all())
    return count


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
                between = ahead[apart.min(axis=1) > strand.radius]
                if sight is None or not sight.empty(between, r).any():
                    found.append((number, other, strand.points[place]))
    return found
