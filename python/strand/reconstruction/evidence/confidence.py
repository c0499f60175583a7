"""Weigh the doubts of answers, and find where they contradict the caller's knowledge of the ropes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

import strand._core as _core
from strand.geometry.polyline import bound_polylines, measure_gaps
from strand.reconstruction.evidence.prior import Prior
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.support.checks import Array, round_to_millimeters

SCALE = 2.5  # a difference of costs, in the unit of `Config.linking`, that multiplies the odds by e
MIN_DOUBT = 1e-3  # smaller doubts are dropped
USUAL_NOISE = 0.21  # radii of noise that raise no doubt
_REACH = 15.0  # radii: a doubt concerns the chains this near its place
_GRAVE = 5.0  # a doubt this grave concerns all chains: the input is wrong
_BASE_DOUBT = 0.01  # doubt of every answer
_JOIN_DOUBT = 0.5  # doubt of a join without any margin
_LENGTH_DOUBT = 0.4  # doubt per radius that a length is wrong beyond what is allowed
_OTHER_UNIT = 100.0  # a known length over the found one: in millimetres it is a thousand times too long
_OPEN_RING_DOUBT = math.log(2.0)  # doubt of each open rope that should be a ring


def compute_trust(doubts: Sequence[Doubt]) -> float:
    """Return a score by which answers to the same views are compared: exp(-0.01 - d), d the sum of doubts."""
    return float(np.exp(-_BASE_DOUBT - sum(doubt.amount for doubt in doubts)))


def assign_doubts(
    chains: Sequence[Chain], doubts: Sequence[Doubt], about: Sequence[tuple[Doubt, tuple[int, ...]]]
) -> list[tuple[Doubt, ...]]:
    """Return the doubts of each chain.

    A doubt with a place concerns the chains that run near it, unless it is grave. A doubt without one
    concerns all chains, unless it names some.

    Parameters
    ----------
    chains : sequence of Chain
    doubts : sequence of Doubt
        All doubts of the model.
    about : sequence of (Doubt, tuple of int)
        Those that name chains.
    """
    named = {id(doubt): numbers for doubt, numbers in about if numbers}
    found: list[list[Doubt]] = [[] for _ in chains]
    boxes = bound_polylines([chain.points for chain in chains])
    reach = _REACH * np.array([chain.radius for chain in chains])
    for doubt in doubts:
        numbers: Sequence[int] | None = named.get(id(doubt))
        if numbers is None:
            if doubt.place is None or doubt.amount >= _GRAVE:
                numbers = range(len(chains))
            else:
                in_reach = np.flatnonzero(measure_gaps(boxes, doubt.place) <= reach).tolist()
                numbers = [k for k in in_reach if _is_near(chains[k], doubt.place)]
        for number in numbers:
            found[number].append(doubt)
    return [tuple(own) for own in found]


def _is_near(chain: Chain, place: Array) -> bool:
    """Tell whether a node of a chain is within reach of a place."""
    (square,) = _core.find_squared_distances(place[None], chain.points)
    return bool(square <= (_REACH * chain.radius) ** 2)


def doubt_margin(margin: float) -> float:
    """Return the doubt that a join with a margin raises."""
    return _JOIN_DOUBT * float(np.exp(-max(margin, 0.0) / SCALE))


def to_normal_deviate(square: float, freedom: int) -> float:
    """Return the standard normal deviate as rare as a chi-square (Wilson and Hilferty 1931)."""
    spread = 2.0 / (9.0 * freedom)
    return float(((square / freedom) ** (1.0 / 3.0) - 1.0 + spread) / math.sqrt(spread))


def find_contradictions(
    chains: Sequence[Chain], surplus: Sequence[Chain], prior: Prior, all_rings: bool
) -> list[tuple[Doubt, tuple[int, ...]]]:
    """Return doubts where an answer contradicts the caller's knowledge of the ropes.

    Parameters
    ----------
    chains : sequence of Chain
        The answer.
    surplus : sequence of Chain
        Further chains that were found, beyond the number of ropes.
    prior : Prior
    all_rings : bool
        Whether all ropes are known to be rings.

    Returns
    -------
    list of (Doubt, tuple of int)
        Each with the numbers of the chains that it concerns.
    """
    found: list[tuple[Doubt, tuple[int, ...]]] = []

    def contradict(
        kind: str, amount: float, reason: str, place: Array | None = None, about: tuple[int, ...] = ()
    ) -> None:
        found.append((Doubt(kind, amount, "whether that is right", reason, place), about))

    if prior.ropes is not None and len(chains) < prior.ropes:
        amount = math.log(prior.ropes / len(chains))
        contradict("count", amount, f"found fewer ropes, {len(chains)}, than ropes = {prior.ropes}")
    all_lengths = sum(chain.length for chain in [*chains, *surplus])
    for chain in surplus:
        where = round_to_millimeters(chain.points[0])
        reason = (
            f"dropped a chain {chain.length * 1e3:.0f} mm long at {where}, more than ropes = {prior.ropes}"
        )
        contradict("count", -math.log1p(-chain.length / all_lengths), reason, chain.points[0])
    lengths = [chain.length for chain in chains]
    true_lengths = prior.match_lengths(lengths) if prior.lengths else [None] * len(chains)
    for number, (chain, true) in enumerate(zip(chains, true_lengths, strict=True)):
        off = prior.measure_excess(chain.length, true, chain.radius)
        if true is not None and off > 0:
            more = chain.length - true
            ask = f"; is length={true:g} in metres?" if true > _OTHER_UNIT * chain.length else ""
            contradict(
                "length",
                _LENGTH_DOUBT * off,
                f"chain {number} is {chain.length * 1e3:.0f} mm long, {abs(more) * 1e3:.0f} mm "
                f"{'longer' if more > 0 else 'shorter'} than it is known to be{ask}",
                about=(number,),
            )
        if all_rings and not chain.closed:
            reason = f"chain {number} has ends, though all ropes are said to be rings"
            contradict("ring", _OPEN_RING_DOUBT, reason, about=(number,))
    return found
