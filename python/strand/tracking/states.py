"""In which state a tracked rope is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strand.tracking.rope_state import COASTING, LOST, TENTATIVE, TRACKING, RopeState

LOST_AGE = 0.5  # s: nothing of a rope was seen for longer
UNEXPLAINED = 0.03  # of the ropes' pixels: above it, the ropes are doubted
THROUGH = 0.08  # of a rope's samples that a camera saw through: above it, likewise
_LOST_THROUGH = 0.5  # of its samples that a camera saw through
_LOST_UNEXPLAINED = 0.4  # of the ropes' pixels: all ropes are lost


def lose_rope(rope: RopeState) -> RopeState:
    """Return a rope at rest, as after a gap between frames: it may be anywhere."""
    state = rope.state if rope.state == TENTATIVE else LOST
    return replace(rope, state=state, velocities=np.zeros_like(rope.velocities))


def confirm_state(rope: RopeState) -> RopeState:
    """Return a rope that another answer has in the same place: its shape is sure, and it is found."""
    return replace(rope, state=TRACKING) if rope.state in (TENTATIVE, LOST) else rope


def judge_state(rope: RopeState, unexplained: float) -> RopeState:
    """Return a rope with its state after a frame, of whose pixels a share is `unexplained`.

    A rope that was lost is found where it explains the frame as well as ropes do that nobody doubts.
    """
    bare = unexplained > _LOST_UNEXPLAINED
    astray = rope.state == LOST and (unexplained > UNEXPLAINED or rope.through > THROUGH)
    unseen = float(rope.scalars[:, 2].min())
    if bare or astray or unseen > LOST_AGE or rope.through > _LOST_THROUGH:
        state = LOST
    elif unseen > 0.0:
        state = COASTING if rope.state != TENTATIVE else TENTATIVE
    elif rope.state == TENTATIVE:
        state = TENTATIVE
    else:
        state = TRACKING
    return replace(rope, state=state)
