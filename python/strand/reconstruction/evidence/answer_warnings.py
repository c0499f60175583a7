"""Warnings about an answer: ropes that may run otherwise, branch, or leave the extraction range."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strand.config import Linking
from strand.reconstruction.evidence.branches import find_branches
from strand.reconstruction.evidence.confidence import doubt_margin
from strand.reconstruction.evidence.visibility import Visibility
from strand.ropes.chain import Chain
from strand.ropes.doubt import Doubt, ModelWarning
from strand.support.checks import round_to_millimeters
from strand.views.box import Box

_AHEAD = 2.0  # radii: an end this near to a face of the extraction range may go on beyond it
_MIN_COSINE = 0.5  # between the end's direction and the face's normal: flatter ends run along the face


def warn_about_answer(
    chains: Sequence[Chain],
    doubts: Sequence[Doubt],
    visibility: Visibility | None,
    bounds: Box | None,
    config: Linking,
) -> Iterator[ModelWarning]:
    """Yield warnings about great doubts, branches, and ends at the extraction range's faces."""
    least = doubt_margin(config.margin)
    for doubt in doubts:
        if doubt.amount > least:
            yield ModelWarning(doubt.kind, str(doubt), doubt.place, doubt.amount)
    for number, trunk, place in find_branches(chains, visibility):
        message = (
            f"chain {number} ends on the side of chain {trunk} at {round_to_millimeters(place)}: a branch? "
            "branches=True (--branches) finds graphs"
        )
        reach = float(np.linalg.norm(chains[number].points[[0, -1]] - place, axis=1).min())
        yield ModelWarning("branch", message, place, reach, (number, trunk))
    if bounds is not None:
        yield from _warn_about_cut_ends(chains, bounds)


def _warn_about_cut_ends(chains: Sequence[Chain], bounds: Box) -> Iterator[ModelWarning]:
    """Yield warnings about ends that run out of the extraction range."""
    for number, chain in enumerate(chains):
        for node, outward in ((chain.points[0], -chain.tangents[0]), (chain.points[-1], chain.tangents[-1])):
            ahead = bounds.express(node + _AHEAD * chain.radius * outward)
            # a rope along a face, as near the table, does not leave the range there
            across = bounds.express_directions(outward)
            out = ((ahead < bounds.low) & (across < -_MIN_COSINE)) | (
                (ahead > bounds.high) & (across > _MIN_COSINE)
            )
            if not chain.closed and out.any():
                where = round_to_millimeters(node)
                message = f"chain {number} runs out of the extraction range at {where}: it may go on"
                yield ModelWarning("cut end", message, node, chains=(number,))
