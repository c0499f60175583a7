"""How sure tracked ropes are: the doubts of the surest reconstruction that has them."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from strand.reconstruction.evidence.measured import measure_bound
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt
from strand.ropes.model import Model
from strand.tracking.rope_state import RopeState, measure_offset

_HIDDEN = "hidden end"
_NEAR = 4.0  # radii around a hidden end: other doubts there are about the same end


def begin_certainty(rope: RopeState, chain: Chain) -> RopeState:
    """Return a rope that is as sure as the chain that it lies on.

    Hidden ends do not count: `covered_ends` and `length_sd` say how far a rope goes on below a cover.
    """
    others = _drop_hidden_ends(chain)
    confidence = chain.confidence * math.exp(measure_bound(chain.doubts) - measure_bound(others))
    return replace(rope, confidence=min(confidence, 1.0), doubts=chain.doubts)


def _drop_hidden_ends(chain: Chain) -> list[Doubt]:
    """Return a chain's doubts without those about ends that something hides."""
    ends = [doubt.place for doubt in chain.doubts if doubt.kind == _HIDDEN and doubt.place is not None]

    def is_there(doubt: Doubt) -> bool:
        place = doubt.place
        return place is not None and any(np.linalg.norm(place - end) < _NEAR * chain.radius for end in ends)

    return [
        doubt
        for doubt in chain.doubts
        if doubt.kind != _HIDDEN and not (doubt.kind == "end" and is_there(doubt))
    ]


def confirm_certainty(rope: RopeState, chain: Chain) -> RopeState:
    """Return a rope that a later chain confirms: the surer of both answers counts."""
    later = begin_certainty(rope, chain)
    return rope if later.confidence < rope.confidence or math.isnan(later.confidence) else later


def contradict_certainty(rope: RopeState, confidence: float) -> RopeState:
    """Return a rope that an answer with a confidence has elsewhere."""
    left = 1.0 - confidence
    if not rope.confidence > left:
        return rope
    doubt = Doubt(
        "rival",
        math.log(rope.confidence / max(left, 1e-3)),
        "where the rope runs",
        "a sure reconstruction of a later frame has it elsewhere",
    )
    return replace(rope, confidence=left, doubts=(doubt, *rope.doubts))


def drop_settled(rope: RopeState) -> RopeState:
    """Return a rope without doubts about hidden ends, beyond the number of those that are covered."""
    hidden = [doubt for doubt in rope.doubts if doubt.kind == _HIDDEN]
    settled = hidden[sum(rope.covered_ends) :]
    return replace(rope, doubts=tuple(doubt for doubt in rope.doubts if doubt not in settled))


def match_chains(model: Model, ropes: Sequence[RopeState]) -> list[Chain]:
    """Return the chain of each rope: the nearest of a model that has at least one."""
    return [
        min(model.chains, key=lambda chain, rope=rope: measure_offset(rope.nodes, chain.points))  # type: ignore[misc]
        for rope in ropes
    ]


def pack_doubts(doubts: Sequence[Doubt]) -> str:
    """Return doubts as JSON."""
    return json.dumps(
        [asdict(doubt) | {"place": None if doubt.place is None else doubt.place.tolist()} for doubt in doubts]
    )


def unpack_doubts(text: str) -> tuple[Doubt, ...]:
    """Return the doubts of `pack_doubts`."""
    return tuple(
        Doubt(**one | {"place": None if one["place"] is None else np.array(one["place"])})
        for one in json.loads(text)
    )
