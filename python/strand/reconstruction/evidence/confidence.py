"""How sure an answer is, and where it is not as the ropes are known to be."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from strand.reconstruction.evidence.prior import Prior
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array, round_to_millimeters

SCALE = 2.5
"""A difference of costs, in the unit of `Config.linking`, that is worth a factor of e in the odds."""

MIN_DOUBT = 1e-3  # smaller doubts are dropped
USUAL_NOISE = 0.21  # radii of noise that raise no doubt

# a doubt is about the chains within so many radii of its place
_REACH = 15.0
# doubt that is always there, and that of a join without any margin
_ALWAYS, _JOIN = 0.01, 0.5
# doubt for each radius that a length is wrong by more than it may be, for each open rope that is a ring
_LENGTH, _OPEN = 0.4, math.log(2.0)


def confidence(doubts: Sequence[Doubt]) -> float:
    """How likely the answer is right: exp(-0.01 - d), where d adds up all doubts."""
    return float(np.exp(-_ALWAYS - sum(doubt.amount for doubt in doubts)))


def of_chains(
    chains: Sequence[Chain], doubts: Sequence[Doubt], about: Sequence[tuple[Doubt, tuple[int, ...]]]
) -> list[tuple[float, tuple[Doubt, ...]]]:
    """Return each chain's own confidence and doubts.

    A doubt with a place is about the chains that run there, and about none if it is far from all. One without
    is about all of them, unless it says which.

    Parameters
    ----------
    chains : sequence of Chain
    doubts : sequence of Doubt
        Of the model.
    about : sequence of (Doubt, tuple of int)
        Those that say which chains they are about.
    """
    named = {id(doubt): numbers for doubt, numbers in about if numbers}
    found: list[list[Doubt]] = [[] for _ in chains]
    for doubt in doubts:
        numbers = named.get(id(doubt))
        if numbers is None:
            numbers = tuple(range(len(chains))) if doubt.place is None else _near(chains, doubt.place)
        for number in numbers:
            found[number].append(doubt)
    return [(confidence(own), tuple(own)) for own in found]


def _near(chains: Sequence[Chain], place: Array) -> tuple[int, ...]:
    """Return the chains within reach of a place."""
    away = [float(np.linalg.norm(chain.points - place, axis=1).min()) / chain.radius for chain in chains]
    return tuple(number for number, distance in enumerate(away) if distance <= _REACH)


def doubt_of_margin(margin: float) -> float:
    """How great a doubt a join of this margin raises."""
    return _JOIN * float(np.exp(-max(margin, 0.0) / SCALE))


def contradictions(
    chains: Sequence[Chain], left_out: Sequence[Chain], prior: Prior, all_rings: bool
) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Say where the ropes that were found are not as they are known to be.

    Parameters
    ----------
    chains : sequence of Chain
        The answer.
    left_out : sequence of Chain
        What was found beside it, beyond the number of ropes.
    prior : Prior
    all_rings : bool
        Whether all ropes are known to be rings.

    Returns
    -------
    list of (Doubt, tuple of int)
        Each with the numbers of the chains that it is about.
    """
    found: list[tuple[Doubt, tuple[int, ...]]] = []

    def contradicts(
        kind: str, amount: float, reason: str, place: Array | None = None, about: tuple[int, ...] = ()
    ) -> None:
        found.append((Doubt(kind, amount, "whether that is right", reason, place), about))

    if prior.ropes is not None and len(chains) < prior.ropes:
        amount = math.log(prior.ropes / len(chains))
        contradicts("count", amount, f"found fewer ropes, {len(chains)}, than ropes = {prior.ropes}")
    all_lengths = sum(chain.length for chain in [*chains, *left_out])
    for chain in left_out:
        where = round_to_millimeters(chain.points[0])
        reason = (
            f"left out a chain {chain.length * 1e3:.0f} mm long at {where}, more than ropes = {prior.ropes}"
        )
        contradicts("count", -math.log1p(-chain.length / all_lengths), reason, chain.points[0])
    lengths = [chain.length for chain in chains]
    true_lengths = prior.expected(lengths) if prior.lengths else [None] * len(chains)
    for number, (chain, true) in enumerate(zip(chains, true_lengths, strict=True)):
        off = prior.length_excess(chain.length, true, chain.radius)
        if true is not None and off > 0:
            more = chain.length - true
            contradicts(
                "length",
                _LENGTH * off,
                f"chain {number} is {chain.length * 1e3:.0f} mm long, {abs(more) * 1e3:.0f} mm "
                f"{'longer' if more > 0 else 'shorter'} than it is known to be",
                about=(number,),
            )
        if all_rings and not chain.closed:
            reason = f"chain {number} has ends, though all ropes are said to be rings"
            contradicts("ring", _OPEN, reason, about=(number,))
    return found
