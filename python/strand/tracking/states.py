"""In which state a tracked rope is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strand.tracking.rope_state import COASTING, LOST, TENTATIVE, TRACKING, RopeState

_LOST_AGE = 0.5  # s: nothing of a rope was seen for longer
_LOST_THROUGH = 0.5  # of its samples that a camera saw through
_LOST_UNEXPLAINED = 0.4  # of the ropes' pixels: all ropes are lost


def stop_rope(rope: RopeState) -> RopeState:
    """Return a rope at rest."""
    return replace(rope, velocities=np.zeros_like(rope.velocities))


def confirm_state(rope: RopeState) -> RopeState:
    """Return a rope whose first shape is sure."""
    return replace(rope, state=TRACKING) if rope.state == TENTATIVE else rope


def judge_state(rope: RopeState, unexplained: float) -> RopeState:
    """Return a rope with its state after a frame, of whose pixels a share is `unexplained`."""
    bare = unexplained > _LOST_UNEXPLAINED
    unseen = float(rope.scalars[:, 2].min())
    if bare or unseen > _LOST_AGE or rope.through > _LOST_THROUGH:
        state = LOST
    elif unseen > 0.0:
        state = COASTING if rope.state != TENTATIVE else TENTATIVE
    elif rope.state == TENTATIVE:
        state = TENTATIVE
    else:
        state = TRACKING
    return replace(rope, state=state)
