"""Bodies that come between the cameras and ropes for a while: a bar, a plate, or nothing but lost images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.synthetic.grippers import ease
from strand.synthetic.objects import Box, Object, cast_rays

_BAR_LENGTH = 0.9  # metres
_BAR_HEIGHT = 0.02  # metres: thickness of the bar and of the plate
_BAR_ABOVE = (0.1, 0.16)  # metres: of the bar above the highest place of ropes and grippers
_BAR_SHARES = (0.3, 0.5)  # of the rope that the bar hides, on average
_BAR_WIDTHS = np.linspace(0.03, 0.3, 55)  # metres
_BAR_STAY = (0.6, 1.4)  # seconds in which the bar hides the rope
_BAR_MOVE = 0.25  # seconds in which the bar comes, or goes
_BAR_BEGIN = (0.5, 0.9)  # seconds: the bar begins to come
_PLATE_SIDE = 3.0  # metres
_PLATE_MOVE = 0.1  # seconds
_DARK = (0.5, 1.0)  # seconds in which nothing is seen


@dataclass(frozen=True)
class Cover:
    """A box that comes, stays and goes; or images without anything.

    Attributes
    ----------
    box : Box or None
        Where it stays; None if images are empty.
    way : (float, float)
        From there to where it comes from and goes to, metres along x and y.
    arrives, leaves : float
        Times between which it stays, seconds.
    move : float
        Time in which it comes, and goes, seconds.
    """

    box: Box | None
    way: tuple[float, float]
    arrives: float
    leaves: float
    move: float

    def is_empty(self, time: float) -> bool:
        """Tell whether the image at a time shows nothing at all."""
        return self.box is None and self.arrives <= time < self.leaves

    def make_objects(self, time: float) -> list[Object]:
        """Return the box at a time, seconds; none while it is away."""
        away = max(self.arrives - time, time - self.leaves, 0.0) / self.move
        if self.box is None or away >= 1.0:
            return []
        share = float(ease(np.array([away]))[0])
        x, y, z = self.box.center
        moved = (x + share * self.way[0], y + share * self.way[1], z)
        return [Box(moved, self.box.size, self.box.turn)]


def draw_blackout(rng: np.random.Generator, highest: float, empty: bool) -> Cover:
    """Return a plate above `highest`, metres, that hides all, or empty images."""
    arrives = float(rng.uniform(0.7, 1.3))
    leaves = arrives + float(rng.uniform(*_DARK))
    if empty:
        return Cover(None, (0.0, 0.0), arrives, leaves, _PLATE_MOVE)
    plate = Box((0.0, 0.0, highest + 0.02), (_PLATE_SIDE, _PLATE_SIDE, _BAR_HEIGHT))
    # the rope is hidden for a part of its coming and going, too
    return Cover(plate, (0.0, _PLATE_SIDE), arrives + 0.05, leaves - 0.05, _PLATE_MOVE)


def draw_bar(
    rng: np.random.Generator, times: Array, nodes: list[Array], highest: float, camera: Array
) -> Cover:
    """Return a bar above `highest`, metres, that hides a part of a rope from a camera's centre.

    `nodes` are those of the rope at each time.
    """
    arrives = float(rng.uniform(*_BAR_BEGIN)) + _BAR_MOVE
    leaves = arrives + float(rng.uniform(*_BAR_STAY))
    share = float(rng.uniform(*_BAR_SHARES))
    height = highest + float(rng.uniform(*_BAR_ABOVE))
    seen = [rope for time, rope in zip(times, nodes, strict=True) if arrives <= time <= leaves]
    middle = np.mean([rope[len(rope) // 2] for rope in seen], axis=0)
    # the bar runs from the camera's side away over the rope, and comes from behind
    behind = math.atan2(-camera[1], -camera[0])
    turn = behind + float(rng.uniform(-0.25, 0.25))
    place = camera + (middle - camera) * (height - camera[2]) / (middle[2] - camera[2])
    center = (float(place[0]), float(place[1]), height)
    best, least = Box(center, (_BAR_LENGTH, float(_BAR_WIDTHS[0]), _BAR_HEIGHT), turn), math.inf
    for width in _BAR_WIDTHS:
        bar = Box(center, (_BAR_LENGTH, float(width), _BAR_HEIGHT), turn)
        hidden = [np.mean(cast_rays(bar, camera, rope - camera) < 1.0) for rope in seen]
        miss = abs(float(np.mean(hidden)) - share)
        if miss < least:
            best, least = bar, miss
    way = (2.0 * math.cos(turn), 2.0 * math.sin(turn))
    return Cover(best, way, arrives, leaves, _BAR_MOVE)
