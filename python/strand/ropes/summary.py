"""An answer in words: whether to act on it, the ropes, their crossings, and the greatest doubts."""

from __future__ import annotations

import math
from collections.abc import Sequence

from strand.ropes.chain import Chain
from strand.ropes.crossings import NOT_LISTED, Crossing
from strand.ropes.doubt import Doubt

ACT_CONFIDENCE = 0.9
"""Confidence from which on a robot may act: fewer than 1 in 100 of these answers are wrong."""
LOOK_CONFIDENCE = 0.5
"""Confidence below which an answer is no better than a guess."""

_MAX_DOUBTS = 3  # in a summary
_ROUNDING = 1e-9  # hundredths: a confidence that is this much lower has its digits


def format_confidence(confidence: float) -> str:
    """Return a confidence with two digits, rounded down so that none seems to reach a limit."""
    if math.isnan(confidence):
        return "nan"
    return f"{math.floor(100.0 * confidence + _ROUNDING) / 100.0:.2f}"


def say_whether_to_act(confidence: float) -> str:
    """Return a sentence that says whether to act on an answer with this confidence."""
    if math.isnan(confidence):
        return "Check it: the method does not say how sure the answer is."
    sure = f"the ropes run as the chains say with probability {format_confidence(confidence)}"
    if confidence >= ACT_CONFIDENCE:
        return f"Act on it: {sure}."
    if confidence >= LOOK_CONFIDENCE:
        return f"Look again before acting: {sure}."
    return f"Do not act on it: {sure}."


def summarize(
    confidence: float,
    chains: Sequence[Chain],
    crossings: Sequence[Crossing] | None,
    doubts: Sequence[Doubt],
) -> str:
    """Return lines: whether to act, each chain, each crossing, and the greatest doubts.

    `crossings` is None if they are too many to list.
    """
    lines = [say_whether_to_act(confidence)]
    lines += [f"chain {number}: {chain!r}" for number, chain in enumerate(chains)]
    lines += [NOT_LISTED] if crossings is None else map(str, crossings)
    lines += map(str, doubts[:_MAX_DOUBTS])
    if len(doubts) > _MAX_DOUBTS:
        lines.append(f"further doubts: {len(doubts) - _MAX_DOUBTS}")
    return "\n".join(lines)
