"""Grippers that hold ropes: how they move, and what they look like."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.synthetic.objects import Box

_FINGER = 0.008  # metres: thickness of a finger
_FINGER_LENGTH = 0.045  # metres: height of a finger
_PALM = (0.03, 0.05, 0.06)  # metres: length along the rope, width and height of the palm
GRIPPER_HEIGHT = _FINGER_LENGTH + _PALM[2]
"""Height of a gripper above the rope's axis, metres."""

_OPEN = 0.008  # metres by which an open gripper's fingers are farther apart, on each side
_RAMP = 0.4  # share of a movement's time in which it gets faster, and again slower


@dataclass(frozen=True, eq=False)
class Gripper:
    """A gripper at one time.

    Attributes
    ----------
    pose : (4, 4) ndarray
        Gripper to world. The origin is on the rope's axis where it holds, x runs along the rope towards its
        last node, and z is up.
    rope : int
        Number of its rope.
    s : float
        Arc length from the rope's first node to the place that it holds, metres.
    holds : bool
        Whether it holds the rope; an open gripper has let it go.
    """

    pose: Array
    rope: int
    s: float
    holds: bool


@dataclass(frozen=True, eq=False)
class GripperPath:
    """The movement of a gripper.

    Attributes
    ----------
    rope : int
    s : float
        Metres.
    half : float
        Half the length of rope between its fingers, metres.
    times : (K,) ndarray
        Seconds, rising.
    places : (K, 3) ndarray
        Metres, world frame.
    turns : (K,) ndarray
        Angle of its x axis about z, radians.
    release : float
        Time at which it lets the rope go, seconds.
    """

    rope: int
    s: float
    half: float
    times: Array
    places: Array
    turns: Array
    release: float = math.inf

    def find_state(self, time: float) -> Gripper:
        """Return the gripper at a time, seconds."""
        turn = float(np.interp(time, self.times, self.turns))
        pose = np.eye(4)
        pose[:2, :2] = [[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]
        pose[:3, 3] = [np.interp(time, self.times, axis) for axis in self.places.T]
        return Gripper(pose, self.rope, self.s, time < self.release)

    def make_objects(self, time: float, radius: float) -> list[Box]:
        """Return its fingers, the jaw above the rope and its palm, for a rope of a radius in metres."""
        state = self.find_state(time)
        turn = float(np.interp(time, self.times, self.turns))
        place, across = state.pose[:3, 3], state.pose[:3, 1]
        bottom = max(float(place[2]) - radius, 0.001)
        top = float(place[2]) + _FINGER_LENGTH
        aside = radius + 0.5 * _FINGER + (0.0 if state.holds else _OPEN)
        middle, length = 0.5 * (bottom + top), 2.0 * self.half
        x, y = float(place[0]), float(place[1])
        fingers: list[Box] = [
            Box(
                (x + side * aside * float(across[0]), y + side * aside * float(across[1]), middle),
                (length, _FINGER, top - bottom),
                turn,
            )
            for side in (-1.0, 1.0)
        ]
        palm = Box((x, y, top + 0.5 * _PALM[2]), _PALM, turn)
        if not state.holds:
            return [*fingers, palm]
        low = float(place[2]) + radius
        return [*fingers, palm, Box((x, y, 0.5 * (low + top)), (length, 2.0 * radius, top - low), turn)]


def ease(share: Array) -> Array:
    """Return how much of a way a movement has done after shares of its time: gently faster, then slower.

    The speed is even in the middle. It rises and falls as a half wave of a cosine.
    """
    x = np.clip(share, 0.0, 1.0)
    top = 1.0 / (1.0 - _RAMP)

    def speed_up(t: Array) -> Array:
        return np.asarray(0.5 * top * (t - _RAMP / math.pi * np.sin(math.pi * t / _RAMP)))

    early, late = speed_up(np.minimum(x, _RAMP)), 1.0 - speed_up(np.minimum(1.0 - x, _RAMP))
    even = 0.5 * top * _RAMP + top * (x - _RAMP)
    return np.asarray(np.where(x < _RAMP, early, np.where(x > 1.0 - _RAMP, late, even)))


def find_duration(length: float, speed: float) -> float:
    """Return the time of a movement with `ease` of a length, metres, whose greatest speed is given, m/s."""
    return length / (speed * (1.0 - _RAMP))


def smooth_corners(corners: Array, rounds: int = 4) -> Array:
    """Return a line along corners (K, 3) with round bends; its ends stay."""
    line = corners
    for _ in range(rounds):
        cut = np.stack([0.75 * line[:-1] + 0.25 * line[1:], 0.25 * line[:-1] + 0.75 * line[1:]], axis=1)
        line = np.vstack([line[:1], cut.reshape(-1, line.shape[1]), line[-1:]])
    return line
