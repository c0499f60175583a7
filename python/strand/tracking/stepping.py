"""One frame of tracked ropes: from the last state to the next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from strand._core import track_frame
from strand.geometry.plane import Plane
from strand.support.checks import Array
from strand.tracking.frame import Frame
from strand.tracking.rope_state import RopeState

STEPS = 7  # of Gauss and Newton in a frame
REPLAY_STEPS = 4  # in a frame that is gone through again
_TIPS_SD = 2.0  # radii: of a length that both tips show
_MOST_LONGER = 5.0  # radii: a rope whose tips are farther off is not followed well
_BEYOND = 0.7  # radii by which a mask reaches beyond both tips of a rope


@dataclass(frozen=True, eq=False)
class Step:
    """The ropes after a frame, and how well they explain it.

    Attributes
    ----------
    ropes : tuple of RopeState
    biases : (C,) ndarray
        Errors of depth of all cameras, metres.
    unexplained : float
        Share of the ropes' pixels that no rope explains.
    pixels : int
    """

    ropes: tuple[RopeState, ...]
    biases: Array
    unexplained: float
    pixels: int

    @property
    def misfit(self) -> float:
        """Share of unexplained pixels, and of samples that cameras saw through, averaged over the ropes."""
        return self.unexplained + float(np.mean([rope.through for rope in self.ropes]))


def step_ropes(
    frame: Frame,
    ropes: Sequence[RopeState],
    biases: Array,
    table: Plane | None,
    elapsed: float,
    *,
    steps: int = STEPS,
    bias_gain: float = 0.1,
    free: bool = False,
) -> Step:
    """Move ropes to where a frame shows them, `elapsed` seconds after their state."""
    inputs = [
        (
            rope.nodes,
            rope.velocities,
            rope.last,
            rope.scalars,
            (rope.radius, rope.spacing),
            rope.slid,
            list(rope.covers),
            [(hold.s / rope.spacing, hold.point, hold.sd) for hold in rope.holds],
        )
        for rope in ropes
    ]
    plane = None
    if table is not None:
        x, y, z = (float(value) for value in table.normal)
        plane = (x, y, z), float(table.offset)
    answers, found, _, unexplained, pixels = track_frame(
        frame.list_cameras(biases), inputs, plane, elapsed, steps=steps, bias_gain=bias_gain, free=free
    )
    moved = tuple(
        adapt_length(
            rope,
            longer,
            nodes=nodes,
            velocities=velocities,
            last=last,
            scalars=scalars,
            slid=slid,
            covers=tuple(covers),
            covariances=covariances,
            seen=seen,
            hidden=hidden,
            through=through,
        )
        for rope, (
            nodes,
            velocities,
            last,
            scalars,
            slid,
            covers,
            covariances,
            seen,
            hidden,
            through,
            longer,
        ) in zip(ropes, answers, strict=True)
    )
    after = np.array(biases, dtype=float)
    for (i, _, _), bias in zip(frame.images, found, strict=True):
        after[i] = bias
    return Step(moved, after, unexplained, pixels)


def adapt_length(rope: RopeState, longer: float | None, **found: Any) -> RopeState:
    """Return a rope as a frame found it, longer by what its tips show, as far as its length is unsure."""
    moved = replace(rope, **found)
    unsure = rope.length_sd > 0 and not any(rope.covered_ends)
    if longer is None or not unsure or abs(longer) > _MOST_LONGER * rope.radius:
        return moved
    variance, noise = rope.length_sd**2, (_TIPS_SD * rope.radius) ** 2
    gain = variance / (variance + noise)
    length = rope.length + gain * (longer - _BEYOND * rope.radius)
    return replace(
        moved, spacing=length / (len(rope.nodes) - 1), length_sd=float(np.sqrt((1.0 - gain) * variance))
    )
