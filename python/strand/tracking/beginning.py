"""How a tracker begins: by answers to the first frames, until several agree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand.ropes.model import Model
from strand.ropes.summary import ACT_CONFIDENCE
from strand.support.checks import Array
from strand.tracking.certainty import begin_certainty
from strand.tracking.frame import Frame
from strand.tracking.laying import fit_length, trim_ends
from strand.tracking.masks import find_mask, learn_colors
from strand.tracking.rope_state import (
    TENTATIVE,
    TRACKING,
    RopeState,
    make_state,
    measure_arcs,
    measure_offset,
    place_at,
    resample,
)

ASKED = 8  # first frames that are asked until answers agree
_AGREED = 3  # answers that agree
_AGREED_SURE = 2  # likewise, if one of them is sure
_SAME = 2.5  # radii: mean distance of two answers that agree
_OUTER = 6.0  # radii at each end that may be something else
_OUTER_SHARE = 0.2  # of the length: likewise, at most
_BEYOND = 24.0  # radii beyond the ends, up to where masks show a tip


@dataclass(frozen=True, eq=False)
class Beginning:
    """An answer to one of the first frames.

    Attributes
    ----------
    model : Model
    frame : Frame
    """

    model: Model
    frame: Frame


def make_beginning(model: Model, frame: Frame) -> Beginning:
    """Return an answer to a frame, with masks of its ropes in the images that have none.

    Colours of the ropes' inner parts make these masks, because chains may go on along what holds an end.
    """
    if frame.is_masked:
        return Beginning(model, frame)
    inner, longer = [], []
    for number, chain in enumerate(model.chains):
        points, radius, length = np.asarray(chain.points), chain.radius, chain.length
        rope = make_state(number, points, radius, length, 0.0, None)
        arcs = rope.spacing * np.arange(len(rope.nodes))
        margin = min(_OUTER * radius, _OUTER_SHARE * length)
        inner.append(replace(rope, hidden=np.minimum(arcs, length - arcs) < margin))
        more = _BEYOND * radius
        line = place_at(points, measure_arcs(points), np.linspace(-more, length + more, len(points)))
        longer.append(make_state(number, line, radius, length + 2.0 * more, 0.0, None))
    masks = list(frame.masks)
    for i, view in enumerate(frame.views):
        if view is not None and view.image is not None and view.image.labels is None:
            colors = learn_colors(view.image, inner, None)
            masks[i] = find_mask(view.image, longer, model.table, colors, 0.0)
    masked = replace(frame, masks=tuple(masks))
    return Beginning(replace(model, chains=tuple(trim_ends(chain, masked) for chain in model.chains)), masked)


def choose_beginning(answers: Sequence[Beginning], ropes: int | None) -> tuple[Beginning, bool] | None:
    """Return the answer to begin with, and whether it is certain; None without one of so many ropes."""
    fit = [one for one in answers if ropes is None or len(one.model.chains) >= ropes]
    if not fit:
        return None
    votes = [sum(agree(one.model, other.model) for other in fit) for one in fit]
    weights = [
        (count, float(np.nan_to_num(one.model.confidence)), i)
        for i, (count, one) in enumerate(zip(votes, fit, strict=True))
    ]
    count, _, best = max(weights)
    sure = any(agree(fit[best].model, one.model) and one.model.confidence >= ACT_CONFIDENCE for one in fit)
    return fit[best], count >= (_AGREED_SURE if sure else _AGREED)


def agree(one: Model, other: Model) -> bool:
    """Tell whether two models have the same ropes, whichever way they run."""
    return len(one.chains) == len(other.chains) and all(
        _is_among(chain.points, other, chain.radius) for chain in one.chains
    )


def confirms(model: Model, ropes: Sequence[RopeState]) -> bool:
    """Tell whether an answer has the ropes that are tracked."""
    return len(model.chains) >= len(ropes) and all(
        _is_among(rope.nodes, model, rope.radius) for rope in ropes
    )


def _is_among(nodes: Array, model: Model, radius: float) -> bool:
    """Tell whether a model has a chain along (N, 3) nodes, whichever way it runs."""
    return min(measure_offset(nodes, chain.points) for chain in model.chains) <= _SAME * radius


def begin_ropes(
    beginning: Beginning, ropes: int | None, lengths: Sequence[float] | None, sure: bool
) -> tuple[RopeState, ...]:
    """Return the ropes of an answer, the longest first, or by their labels if all have one."""
    model, frame = beginning.model, beginning.frame
    chains = sorted(model.chains, key=lambda chain: -chain.length)
    chains = chains if ropes is None else chains[:ropes]
    if all(chain.label is not None for chain in chains):
        chains.sort(key=lambda chain: chain.label or 0)
    known = _assign_lengths([chain.length for chain in chains], lengths)
    begun = []
    for number, (chain, length) in enumerate(zip(chains, known, strict=True)):
        points, deviation = fit_length(chain, chains, length, frame)
        # a known length that the rope cannot have is not believed
        whole = float(measure_arcs(points)[-1]) if length is None or deviation > 0 else length
        state = make_state(number, points, chain.radius, whole, deviation, chain.label)
        # what was added beyond the chain's ends is below something
        to_chain = np.linalg.norm(state.nodes[:, None] - np.asarray(chain.points), axis=2).min(axis=1)
        state = replace(state, hidden=to_chain > chain.radius)
        begun.append(begin_certainty(replace(state, state=TRACKING if sure else TENTATIVE), chain))
    return tuple(begun)


def _assign_lengths(found: Sequence[float], lengths: Sequence[float] | None) -> list[float | None]:
    """Return the known length of each rope: the longest belongs to the longest."""
    if lengths is None:
        return [None] * len(found)
    known = sorted(lengths, reverse=True)
    known = known * len(found) if len(known) == 1 else known
    result: list[float | None] = [None] * len(found)
    for length, i in zip(known, np.argsort([-one for one in found]), strict=False):
        result[int(i)] = length
    return result


def keep_order(before: Sequence[RopeState], after: Sequence[RopeState]) -> tuple[RopeState, ...]:
    """Return ropes that begin anew with the numbers and directions of those that they replace."""
    if len(before) != len(after):
        return tuple(after)
    free = list(after)
    kept = []
    for old in before:
        costs = []
        for new in free:
            line = resample(new.nodes, np.linspace(0.0, 1.0, len(old.nodes)))
            ways = [float(np.linalg.norm(way - old.nodes, axis=1).mean()) for way in (line, line[::-1])]
            costs.append((min(ways), ways[1] < ways[0]))
        best = min(range(len(free)), key=lambda i: costs[i][0])
        new = free.pop(best)
        if costs[best][1]:
            new = replace(new, nodes=new.nodes[::-1].copy(), last=new.last[::-1].copy())
        kept.append(replace(new, number=old.number, label=old.label))
    return tuple(kept)
