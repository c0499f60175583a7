"""How sure a decision is: margins of joins, ends that could lie elsewhere, confidence of the whole."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strand.assembly import Chains, Judged
from strand.config import Linking
from strand.ends import string_parts
from strand.model import Chain, Join
from strand.pieces import unexplained
from strand.topology import path_length
from strand.view import Array
from strand.visibility import Sight

# margins are in the units of the costs; this much is worth a factor of e in the odds
_SCALE = 2.5
# a string may go on unseen for this far beyond its end before that matters, in radii
_BEYOND = (1.5, 2.5, 3.5)


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


def features(
    judged: Sequence[Judged], joins: Sequence[Join], chains: Sequence[Chain], sight: Sight, radius: float
) -> dict[str, float]:
    """What tells right answers from wrong ones.

    Returns
    -------
    dict of str to float
        "rival": how much more the next best explanation costs; "joins": the doubt about all joins; "ends":
        how many ends could go on unseen; "lost": share of unexplained points; "noise": the residuals'
        deviation in radii;
        "thin": points for each radius of string; "gap": the longest stretch without points, in radii;
        "stray": ends that lie within another strand's reach.
    """
    fit = judged[0].fit
    rival = judged[1].cost - judged[0].cost if len(judged) > 1 else 50.0
    doubt = sum(float(np.exp(-max(join.margin, 0.0) / _SCALE)) for join in joins)
    hidden = 0
    for chain in chains:
        if chain.closed:
            continue
        for end, inner in ((0, 4), (-1, -5)):
            inner = inner if len(chain.points) > 4 else -1 - end
            out = chain.points[end] - chain.points[inner]
            out /= np.linalg.norm(out)
            places = chain.points[end] + radius * np.array(_BEYOND)[:, None] * out
            hidden += bool(sight.hidden(places, radius)[:2].all())
    gap = 0.0
    for chain in chains:
        if chain.points_seen is not None:
            bare = np.flatnonzero(np.diff(np.concatenate([[0], chain.points_seen == 0, [0]])))
            runs = bare.reshape(-1, 2)
            step = chain.length / max(len(chain.points) - 1, 1)
            gap = max([gap, *((runs[:, 1] - runs[:, 0]) * step / radius).tolist()])
    parts = [part for part in string_parts(fit, exclusive=False) if part is not None]
    lost = unexplained(fit)
    return {
        "rival": float(rival),
        "joins": doubt,
        "ends": float(hidden),
        "lost": float(lost.mean()),
        "noise": fit.sigma / radius,
        "thin": float((~lost).sum() * radius / max(sum(part.length for part in parts), radius)),
        "gap": float(gap),
        "views": float(len(sight.cameras)),
    }
