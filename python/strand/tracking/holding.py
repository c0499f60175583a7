"""Grippers that hold ropes, as a tracker is told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from strand.support.checks import Array, check_number, check_rigid_motion, check_small_array, to_array
from strand.tracking.rope_state import Hold, RopeState

Place = tuple[int, float]
"""Number of a rope, and arc length along it, metres."""

_SD = 0.5  # radii: standard deviation of a gripper's place on the rope
_SAME = 4.0  # radii: places that are nearer are the same hold
_SHORTEST = 5e-3  # s between two poses: velocities of nearer ones are noise
_REACH = 20.0  # radii: a gripper may be farther from the rope than its length allows
_LONGEST = 0.2  # s: a gripper goes on with its velocity for no longer


@dataclass(frozen=True, eq=False)
class Held:
    """Where a gripper was, how it moved, m/s, and when; None for the time of the next frame."""

    point: Array
    velocity: Array
    time: float | None

    def place_at(self, time: float) -> Array:
        """Return where the gripper is at a time, (3,) metres."""
        ahead = 0.0 if self.time is None else float(np.clip(time - self.time, -_LONGEST, _LONGEST))
        return self.point + ahead * self.velocity


def hold_place(before: Held | None, pose: ArrayLike, time: float | None) -> Held:
    """Return where a gripper is, after where it was."""
    flat = to_array("pose", pose).ndim == 1
    point = check_small_array("pose", pose, (3,)) if flat else check_rigid_motion("pose", pose)[:3, 3].copy()
    at = None if time is None else check_number("time", time)
    if before is None or before.time is None or at is None or at < before.time + _SHORTEST:
        return Held(point, np.zeros(3), at)
    return Held(point, (point - before.point) / (at - before.time), at)


def check_reach(rope: RopeState, s: float, point: Array) -> None:
    """Check that a rope is long enough to reach from what is seen of it to where a gripper holds it.

    Raises
    ------
    ValueError
        If it is not.
    """
    arcs = rope.spacing * np.arange(len(rope.nodes))
    beyond = np.linalg.norm(rope.nodes - point, axis=1) - np.abs(arcs - s) - _REACH * rope.radius
    if (beyond[~rope.hidden] > 0).any():
        raise ValueError(
            f"pose: expected a place that rope {rope.number} reaches at {s:g} m, "
            f"got {point.round(3).tolist()}"
        )


def find_rope(ropes: Sequence[RopeState], number: int) -> RopeState:
    """Return the rope of a number.

    Raises
    ------
    ValueError
        If there is none.
    """
    for rope in ropes:
        if rope.number == number:
            return rope
    numbers = ", ".join(str(rope.number) for rope in ropes) or "none yet"
    raise ValueError(f"rope: expected the number of a tracked rope ({numbers}), got {number}")


def find_hold(holds: Mapping[Place, Held], rope: RopeState, s: float, reach: float = _SAME) -> Place | None:
    """Return the hold that is nearest to a place along a rope, within some radii."""
    own = [(abs(place[1] - s), place) for place in holds if place[0] == rope.number]
    if not own:
        return None
    distance, place = min(own)
    return place if distance <= reach * rope.radius else None


def place_holds(
    ropes: Sequence[RopeState], holds: Mapping[Place, Held], time: float
) -> tuple[RopeState, ...]:
    """Return ropes with the places where grippers hold them at a time."""
    held = []
    for rope in ropes:
        own = []
        for (number, s), hold in holds.items():
            if number == rope.number:
                x, y, z = (float(value) for value in hold.place_at(time))
                own.append(Hold(min(max(s, 0.0), rope.length), (x, y, z), _SD * rope.radius))
        held.append(replace(rope, holds=tuple(own)))
    return tuple(held)
