"""When a tracker asks for another opinion, and whether it takes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strand.geometry.plane import Plane
from strand.ropes.model import Model
from strand.ropes.summary import ACT_CONFIDENCE
from strand.support.checks import Array
from strand.tracking.frame import Frame
from strand.tracking.laying import lay_ropes
from strand.tracking.rope_state import RopeState, measure_arcs
from strand.tracking.states import THROUGH, UNEXPLAINED
from strand.tracking.stepping import Step, step_ropes

_GAIN_DOUBTED = 0.012  # by which another answer explains an image better, where the ropes are doubted
_GAIN = 0.02  # likewise, where they are not
_AS_GOOD = 0.005  # by which a sure answer with other ropes may explain an image worse
_STRETCH = 0.06  # of the length: another answer that stretches a rope by more is refused
_MOVED = 5.0  # radii: a node that another answer moves by more begins a new generation
_MIN_CONFIDENCE = 0.05  # of an answer that is taken
_KEPT_SPEED = 0.9  # share of velocities that a rope keeps when it is laid anew
_LAY_STEPS = 6


def is_doubtful(step: Step) -> bool:
    """Tell whether ropes fail to explain a frame."""
    return step.unexplained > UNEXPLAINED or any(rope.through > THROUGH for rope in step.ropes)


@dataclass(frozen=True, eq=False)
class Opinion:
    """Another answer, at the frame that it is of.

    Attributes
    ----------
    step : Step
        The ropes as it has them.
    is_better : bool
        Whether it explains the frame better.
    dissents : bool
        Whether it is sure, explains the frame as well, and yet has ropes elsewhere.
    """

    step: Step
    is_better: bool
    dissents: bool


def compare_opinion(
    model: Model, frame: Frame, step: Step, table: Plane | None, elapsed: float, doubted: bool
) -> Opinion | None:
    """Compare another answer with the ropes after a frame; None if it cannot be true."""
    if model.confidence < _MIN_CONFIDENCE:
        return None
    laid = lay_ropes(step.ropes, model.chains)
    if laid is None:
        return None
    ropes = [
        replace(rope, nodes=nodes, velocities=np.zeros_like(nodes), slid=None)
        for rope, nodes in zip(step.ropes, laid, strict=True)
    ]
    other = step_ropes(frame, ropes, step.biases, table, elapsed, steps=_LAY_STEPS, bias_gain=0.0, free=True)
    if _measure_stretch(other.ropes) > _STRETCH:
        return None
    gain = _GAIN_DOUBTED if doubted else _GAIN
    taken = [_take(before, after) for before, after in zip(step.ropes, other.ropes, strict=True)]
    moved = any(new.generation != old.generation for old, new in zip(step.ropes, taken, strict=True))
    sure = model.confidence >= ACT_CONFIDENCE and len(model.chains) == len(step.ropes)
    return Opinion(
        replace(other, ropes=tuple(taken)),
        other.misfit <= step.misfit - gain,
        moved and sure and other.misfit <= step.misfit + _AS_GOOD,
    )


def _take(before: RopeState, after: RopeState) -> RopeState:
    moved = float(np.linalg.norm(after.nodes - before.nodes, axis=1).max())
    if moved <= _MOVED * before.radius:
        return replace(after, velocities=before.velocities)
    return replace(after, velocities=_KEPT_SPEED * before.velocities, generation=before.generation + 1)


def _measure_stretch(ropes: Sequence[RopeState]) -> float:
    """Return by how much the worst rope is longer or shorter than it is known to be, as a share."""
    ratios: Array = np.array([measure_arcs(rope.nodes)[-1] / rope.length for rope in ropes])
    return float(np.abs(ratios - 1.0).max())
