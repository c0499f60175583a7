"""Bodies that come between a camera and ropes for a while: a bar, a post, a plate; or empty images."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strand.support.checks import Array
from strand.synthetic.grippers import ease
from strand.synthetic.objects import Box, cast_rays

_LENGTH = 0.9  # metres: of the bar, and of the post
_THICKNESS = 0.02  # metres: of the bar, the post and the plate
_ABOVE = (0.1, 0.16)  # metres: of the bar above the highest place of grippers
_BEFORE = 0.55  # place of the post on the way from the camera to the rope's middle
_SHARES = (0.3, 0.5)  # of the rope that the bar or the post hides, on average
_MAX_SHARE = 0.54  # of the rope that it hides at any time
_WIDTHS = np.linspace(0.02, 0.3, 57)  # metres: of the bar, or the post
_STAY = (0.6, 1.4)  # seconds in which it stays
_MOVE = 0.25  # seconds in which it comes, or goes
_BEGIN = (0.5, 0.9)  # seconds: it begins to come
_AWAY = 1.5  # metres to where it comes from
_PLATE_SIDE = 3.0  # metres
_PLATE_MOVE = 0.1  # seconds
_DARK = (0.55, 0.95)  # seconds in which nothing is seen
_DARK_BEGIN = (0.7, 1.3)  # seconds: nothing is seen from then on


@dataclass(frozen=True)
class Cover:
    """A box that comes, stays and goes; or images without anything.

    Attributes
    ----------
    box : Box or None
        Where it stays; None if images are empty.
    way : (float, float, float)
        From there to where it comes from and goes to, metres.
    arrives, leaves : float
        Times between which it stays, seconds.
    move : float
        Time in which it comes, and goes, seconds.
    """

    box: Box | None
    way: tuple[float, float, float]
    arrives: float
    leaves: float
    move: float

    def is_empty(self, time: float) -> bool:
        """Tell whether the image at a time shows nothing at all."""
        return self.box is None and self.arrives <= time < self.leaves

    def make_objects(self, time: float) -> list[Box]:
        """Return the box at a time, seconds; none while it is away."""
        away = max(self.arrives - time, time - self.leaves, 0.0) / self.move
        if self.box is None or away >= 1.0:
            return []
        share = float(ease(np.array([away]))[0])
        x, y, z = self.box.center
        moved = (x + share * self.way[0], y + share * self.way[1], z + share * self.way[2])
        return [Box(moved, self.box.size, self.box.turn)]


def draw_blackout(rng: np.random.Generator, highest: float, empty: bool) -> Cover:
    """Return a plate above `highest`, metres, that hides all, or empty images."""
    arrives = float(rng.uniform(*_DARK_BEGIN))
    leaves = arrives + float(rng.uniform(*_DARK))
    if empty:
        return Cover(None, (0.0, 0.0, 0.0), arrives, leaves, _PLATE_MOVE)
    plate = Box((0.0, 0.0, highest + _THICKNESS), (_PLATE_SIDE, _PLATE_SIDE, _THICKNESS))
    # all of the rope is hidden for a part of the plate's coming and going, too
    shorter = 0.5 * _PLATE_MOVE
    return Cover(plate, (0.0, _PLATE_SIDE, 0.0), arrives + shorter, leaves - shorter, _PLATE_MOVE)


def draw_bar(
    rng: np.random.Generator, times: Array, nodes: list[Array], highest: float, camera: Array
) -> Cover:
    """Return a bar that lies in the air above `highest`, metres, and hides a part of a rope from a camera.

    `nodes` are those of the rope at each time, and `camera` is the camera's centre.
    """
    arrives, leaves, seen = _draw_stay(rng, times, nodes)
    middle = np.mean([rope[len(rope) // 2] for rope in seen], axis=0)
    height = highest + float(rng.uniform(*_ABOVE))
    place = camera + (middle - camera) * (height - camera[2]) / (middle[2] - camera[2])
    turn = math.atan2(-camera[1], -camera[0]) + float(rng.uniform(-0.25, 0.25))
    center = (float(place[0]), float(place[1]), height)
    bars = [Box(center, (_LENGTH, float(width), _THICKNESS), turn) for width in _WIDTHS]
    bar = _choose_box(bars, seen, camera, float(rng.uniform(*_SHARES)))
    # it comes from behind, and points at the camera
    return Cover(bar, (_AWAY * math.cos(turn), _AWAY * math.sin(turn), 0.0), arrives, leaves, _MOVE)


def draw_post(rng: np.random.Generator, times: Array, nodes: list[Array], camera: Array) -> Cover:
    """Return an upright post before a rope in the air, which it hides a part of, see `draw_bar`."""
    arrives, leaves, seen = _draw_stay(rng, times, nodes)
    middle = np.mean([rope[len(rope) // 2] for rope in seen], axis=0)
    place = camera + _BEFORE * (middle - camera)
    turn = math.atan2(middle[1] - camera[1], middle[0] - camera[0])
    center = (float(place[0]), float(place[1]), float(place[2]))
    posts = [Box(center, (_THICKNESS, float(width), _LENGTH), turn) for width in _WIDTHS]
    post = _choose_box(posts, seen, camera, float(rng.uniform(*_SHARES)))
    return Cover(post, (0.0, 0.0, _AWAY), arrives, leaves, _MOVE)


def _draw_stay(
    rng: np.random.Generator, times: Array, nodes: list[Array]
) -> tuple[float, float, list[Array]]:
    """Return when a box arrives and leaves, seconds, and a rope's nodes at the times between."""
    arrives = float(rng.uniform(*_BEGIN)) + _MOVE
    leaves = arrives + float(rng.uniform(*_STAY))
    seen = [rope for time, rope in zip(times, nodes, strict=True) if arrives <= time <= leaves]
    return arrives, leaves, seen


def _choose_box(boxes: list[Box], ropes: list[Array], camera: Array, share: float) -> Box:
    """Return the box that hides a share of the ropes' nodes, on average, as nearly as one does."""
    rays = np.stack(ropes) - camera
    hidden = np.stack([(cast_rays(box, camera, rays) < 1.0).mean(axis=1) for box in boxes])
    misses = np.abs(hidden.mean(axis=1) - share) + (hidden.max(axis=1) > _MAX_SHARE)
    return boxes[int(np.argmin(misses))]
