"""Arrows of Foxglove: which way ropes run, how pulls move them, and where grasps come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from strand.ropes.chain import Chain
from strand.ropes.crossings import Crossing
from strand.ropes.grasps import Gripper, find_grasps
from strand.ropes.model import Model, list_ends
from strand.ropes.pulls import plan_pulls
from strand.support.checks import Array

Message = dict[str, Any]

_DECIMALS = 6  # of metres: micrometres
_AROUND = 5.0  # radii: diameter of a head around a rope
_HEAD = 6.0  # radii: length of that head
_WIDTH = 1.5  # radii: diameter of a free shaft
_MAX_HEAD_SHARE = 0.4  # of an arrow is its head at most
_PULL = {"r": 0.84, "g": 0.15, "b": 0.16, "a": 1.0}  # red: the first move
_LATER_PULL = _PULL | {"a": 0.3}
_GRASP = {"r": 0.17, "g": 0.63, "b": 0.17, "a": 1.0}  # green


def draw_direction(chain: Chain, color: Message) -> Message:
    """Return an arrow in the middle of a chain that points to its last node."""
    middle, head = 0.5 * chain.length, min(_HEAD * chain.radius, 0.5 * chain.length)
    ahead = chain.tangent_at(middle)
    tail = chain.at(middle) - head * ahead
    return _draw(tail, ahead, head, head, (2.0 * chain.radius, _AROUND * chain.radius), color)


def draw_pulls(model: Model, crossings: Sequence[Crossing]) -> list[Message]:
    """Return an arrow for each move of a plan; all but the first are faint, as it alone is sure."""
    arrows = []
    for number, pull in enumerate(plan_pulls(model.chains, crossings, model.up, list_ends(model)).pulls):
        radius, color = model.chains[pull.chain].radius, _LATER_PULL if number else _PULL
        arrows.append(_draw_free(pull.place, pull.direction, pull.distance, radius, color))
    return arrows


def draw_grasps(model: Model, crossings: Sequence[Crossing], gripper: Gripper) -> list[Message]:
    """Return an arrow, as long as the fingers, to the best grasp of each chain."""
    arrows: dict[int, Message] = {}
    # the best come first
    for grasp in find_grasps(model.chains, gripper, crossings, model.table, model.up):
        if grasp.chain not in arrows:
            tail = grasp.pose[:3, 3] - gripper.depth * grasp.approach
            radius = model.chains[grasp.chain].radius
            arrows[grasp.chain] = _draw_free(tail, grasp.approach, gripper.depth, radius, _GRASP)
    return list(arrows.values())


def make_point(place: Array) -> Message:
    """Return a place (3,), metres, as a message."""
    return dict(zip("xyz", np.round(place, _DECIMALS).tolist(), strict=True))


def _draw_free(tail: Array, direction: Array, length: float, radius: float, color: Message) -> Message:
    head = min(_HEAD * radius, _MAX_HEAD_SHARE * length)
    width = _WIDTH * radius
    return _draw(tail, direction, length, head, (width, 2.0 * width), color)


def _draw(
    tail: Array, direction: Array, length: float, head: float, diameters: tuple[float, float], color: Message
) -> Message:
    """Return an arrow by its whole length, that of its head, and the diameters of shaft and head, metres."""
    return {
        "pose": {"position": make_point(tail), "orientation": _turn_to(direction)},
        "shaft_length": length - head,
        "shaft_diameter": diameters[0],
        "head_length": head,
        "head_diameter": diameters[1],
        "color": color,
    }


def _turn_to(direction: Array) -> Message:
    """Return the quaternion that turns the x axis to a unit vector."""
    x, y, z = direction.tolist()
    # half a turn about z where the vector is opposite
    quaternion = np.array([0.0, -z, y, 1.0 + x]) if x > -1.0 + 1e-9 else np.array([0.0, 0.0, 1.0, 0.0])
    quaternion /= np.linalg.norm(quaternion)
    return dict(zip("xyzw", quaternion.tolist(), strict=True))
