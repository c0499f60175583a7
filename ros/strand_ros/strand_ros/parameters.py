"""The node's parameters: names, defaults, ranges, meanings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import strand

MODES = ("track", "reconstruct")
_COLOR_PARTS = 3  # red, green and blue
_CORNERS = 6  # numbers of two corners


@dataclass(frozen=True)
class Parameter:
    """A parameter; `least` and `most` are the range of a number."""

    name: str
    default: Any
    description: str
    least: float | None = None
    most: float | None = None


PARAMETERS = (
    Parameter("mode", "track", "track: the same ropes in every image; reconstruct: each image by itself"),
    Parameter("world_frame", "", "TF frame of the answers; empty: that of the camera, without TF"),
    Parameter("radius", 0.0, "radius of the ropes, metres; 0: unknown", 0.0, 0.1),
    Parameter("ropes", 0, "number of ropes; 0: unknown", 0, 64),
    Parameter("lengths", [0.0], "length of all ropes, or one for each, metres; [0.0]: unknown"),
    Parameter("bounds", [0.0] * _CORNERS, "low and high corner of a box with the ropes, metres; zeros: none"),
    Parameter("deadline", 0.0, "seconds after which reconstruct starts no optional step; 0: none", 0.0, 60.0),
    Parameter("use_color", True, "wait for a colour image of the depth image's pixels"),
    Parameter("use_mask", False, "wait for a mask of the ropes in the depth image's pixels"),
    Parameter("use_occluders", False, "wait for a mask of the robot in the depth image's pixels"),
    Parameter("rope_color", [-1], "the ropes' red, green, blue, 0 to 255, for a mask by colour; [-1]: none"),
    Parameter("depth_scale", 0.0, "metres of a unit of depth; 0: by the encoding", 0.0, 1.0),
    Parameter("rectified", False, "images are rectified: use P of CameraInfo instead of K"),
    Parameter("ignore_distortion", False, "use images of lenses with distortion as they are"),
    Parameter("tolerance", 0.02, "seconds between depth and its colour or mask, at most", 0.0, 1.0),
    Parameter("patience", 0.5, "seconds that depth waits for TF, colour, mask and CameraInfo", 0.01, 10.0),
    Parameter("queue", 30, "images of a topic that wait, at most", 1, 300),
    Parameter("least_confidence", 0.5, "points and markers leave out ropes below it", 0.0, 1.0),
    Parameter("cloud_rope", 0, "id of the rope whose nodes are the points", 0, 63),
    Parameter("cloud_nodes", 0, "number of points, at equal distances; 0: the rope's nodes", 0, 10000),
)


@dataclass(frozen=True)
class Settings:
    """Checked parameters, with None for what is unknown. `known` are the arguments of strand."""

    mode: str
    world_frame: str
    known: dict[str, Any]
    bounds: strand.Box | None
    deadline: float | None
    needed: tuple[str, ...]
    rope_color: tuple[int, ...] | None
    depth_scale: float | None
    rectified: bool
    ignore_distortion: bool
    tolerance: float
    patience: float
    queue: int
    least_confidence: float
    cloud_rope: int
    cloud_nodes: int


def read_settings(values: Mapping[str, Any]) -> Settings:
    """Return the settings of parameters by name; those that are missing have their defaults.

    Raises
    ------
    ValueError
        If a parameter is unknown, out of range, or contradicts another one.
    """
    given = {one.name: one.default for one in PARAMETERS} | dict(values)
    for name in set(given) - {one.name for one in PARAMETERS}:
        raise ValueError(f"{name}: no such parameter")
    for one in PARAMETERS:
        value = given[one.name]
        if one.least is not None and one.most is not None and not one.least <= value <= one.most:
            raise ValueError(f"{one.name}: expected {one.least:g} to {one.most:g}, got {value}")
    if given["mode"] not in MODES:
        raise ValueError(f"mode: expected {' or '.join(MODES)}, got {given['mode']!r}")
    corners, color = list(given["bounds"]), tuple(given["rope_color"])
    if len(corners) != _CORNERS:
        raise ValueError(f"bounds: expected {_CORNERS} numbers, got {len(corners)}")
    try:
        bounds = strand.Box(np.array(corners[:3]), np.array(corners[3:])) if any(corners) else None
    except ValueError as error:
        raise ValueError(f"bounds: {error}") from error
    if color == (-1,):
        color = ()
    if color and (len(color) != _COLOR_PARTS or not all(0 <= part <= 255 for part in color)):
        raise ValueError(f"rope_color: expected 3 numbers from 0 to 255, got {list(color)}")
    if color and not given["use_color"]:
        raise ValueError("rope_color: expected use_color along with it")
    if color and given["use_mask"]:
        raise ValueError("rope_color: expected no use_mask along with it: both give the mask")
    if given["mode"] == "track" and not (given["use_color"] or given["use_mask"]):
        raise ValueError("mode: expected use_color or use_mask along with track")
    if given["mode"] == "track" and bounds is not None:
        raise ValueError("bounds: expected reconstruct along with it; a tracker takes none")
    lengths = [length for length in given["lengths"] if length]
    known: dict[str, Any] = {
        "radius": given["radius"] or None,
        "ropes": given["ropes"] or None,
        "length": (lengths[0] if len(lengths) == 1 else lengths) if lengths else None,
    }
    try:
        strand.Tracker(**known)  # refuses what contradicts itself
    except ValueError as error:
        raise ValueError(re.sub("^length:", "lengths:", str(error))) from error
    return Settings(
        mode=given["mode"],
        world_frame=given["world_frame"],
        known=known,
        bounds=bounds,
        deadline=given["deadline"] or None,
        needed=tuple(name for name in ("color", "mask", "occluders") if given[f"use_{name}"]),
        rope_color=color or None,
        depth_scale=given["depth_scale"] or None,
        rectified=given["rectified"],
        ignore_distortion=given["ignore_distortion"],
        tolerance=given["tolerance"],
        patience=given["patience"],
        queue=given["queue"],
        least_confidence=given["least_confidence"],
        cloud_rope=given["cloud_rope"],
        cloud_nodes=given["cloud_nodes"],
    )
