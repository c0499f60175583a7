"""Parse a `scene.toml`: lengths, the camera, the views and their poses."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np

from strand.support.checks import Array, check_number, check_rigid_motion, check_stamp, describe_value
from strand.views.box import Bounds, Box, make_box
from strand.views.pose import pose_from_angles, turntable_pose

POWER_OF_TEN = {"mm": -3, "cm": -2, "m": 0, None: 0}  # of each unit in metres
_FILES = ("file", "color", "mask", "occluders")
LENGTH = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d{1,4})?)\s*(mm|cm|m)?\s*")


@dataclass(frozen=True, eq=False)
class RecordedView:
    """A view of a `scene.toml`; its files are relative to the folder of the `scene.toml`.

    Attributes
    ----------
    file : str
        The depth image or the points.
    pose : (4, 4) ndarray
        Camera to world.
    color, mask, occluders : str or None
        The colour image, the mask and the occluders of a depth image.
    stamp : float or None
        When it was taken, seconds.
    """

    file: str
    pose: Array
    color: str | None = None
    mask: str | None = None
    occluders: str | None = None
    stamp: float | None = None

    @property
    def files(self) -> dict[str, str]:
        """The view's files by key."""
        named = {key: getattr(self, key) for key in _FILES}
        return {key: name for key, name in named.items() if name is not None}


@dataclass(frozen=True, eq=False)
class Description:
    """The content of a `scene.toml`.

    Attributes
    ----------
    name : str or None
    intrinsics : (3, 3) ndarray or None
        The camera's pinhole matrix, pixels.
    depth_scale : float or None
        Metres per unit of a 16-bit depth image.
    bounds : pair of (3,) ndarray, Box, or None
        The extraction range, metres.
    radius : float or None
        The ropes' radius, metres.
    views : tuple of RecordedView
    """

    name: str | None
    intrinsics: Array | None
    depth_scale: float | None
    bounds: Bounds | None
    radius: float | None
    views: tuple[RecordedView, ...]


def parse_length(value: str | float) -> float:
    """Return a length in metres from a number of metres, or text such as "4.2mm" or "0.42 cm"."""
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        raise TypeError(
            f"length: expected a number of metres or text such as '4.2mm', got {describe_value(value)}"
        )
    match = LENGTH.fullmatch(value if isinstance(value, str) else repr(value))
    if match is None:
        raise ValueError(
            f"length: expected metres, or a number with mm, cm or m, got {describe_value(value)}"
        )
    number, unit = match.groups()
    # shift the decimal point, as 4.2 * 0.001 differs from 0.0042 in the last digit
    length = float(Decimal(number).scaleb(POWER_OF_TEN[unit]))
    if not math.isfinite(length):
        raise ValueError(f"length: expected a finite number, got {describe_value(value)}")
    return length


def parse_description(table: Mapping[str, Any]) -> Description:
    """Convert the tables of a `scene.toml`, which `strand.load_scene` documents; errors name the key."""
    _check_keys("scene", table, accepted=("name", "radius", "camera", "extract", "turntable", "view"))
    views = table.get("view", [])
    if not isinstance(views, list) or not views:
        raise ValueError("view: expected at least one [[view]] table")
    intrinsics, depth_scale = _parse_camera(table["camera"]) if "camera" in table else (None, None)
    return Description(
        name=_parse_name(table["name"]) if "name" in table else None,
        intrinsics=intrinsics,
        depth_scale=depth_scale,
        bounds=_parse_bounds(table["extract"]) if "extract" in table else None,
        radius=_parse_radius(table["radius"]) if "radius" in table else None,
        views=tuple(_parse_view(f"view {i}", view, table.get("turntable")) for i, view in enumerate(views)),
    )


def _parse_name(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(f"name: expected text, got {describe_value(value)}")
    return value


def _parse_camera(table: Any) -> tuple[Array, float | None]:
    required = ("fx", "fy", "cx", "cy")
    _check_keys("camera", table, accepted=(*required, "depth_scale"), required=required)
    fx, fy, cx, cy = (_parse_number(f"camera.{key}", table[key]) for key in required)
    if fx <= 0 or fy <= 0:
        raise ValueError(f"camera: expected fx, fy > 0 pixels, got {fx} and {fy}")
    depth_scale = None
    if "depth_scale" in table:
        depth_scale = _parse_number("camera.depth_scale", table["depth_scale"])
        if depth_scale <= 0:
            raise ValueError(f"camera.depth_scale: expected metres per unit > 0, got {depth_scale}")
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), depth_scale


def _parse_bounds(table: Any) -> Bounds:
    pose = ("pose", "angles_deg", "origin")
    _check_keys("extract", table, accepted=("low", "high", *pose), required=("low", "high"))
    box = make_box(
        (_parse_numbers("extract.low", table["low"]), _parse_numbers("extract.high", table["high"]))
    )
    return (
        Box(box.low, box.high, _parse_pose("extract", table))
        if set(pose) & set(table)
        else (box.low, box.high)
    )


def _parse_radius(value: Any) -> float:
    radius = parse_length(value)
    if radius <= 0:
        raise ValueError(f"radius: expected a positive length, got {describe_value(value)}")
    return radius


def _parse_view(name: str, table: Any, turntable: Any) -> RecordedView:
    accepted = (*_FILES, "stamp", "pose", "angles_deg", "origin", "turntable_deg")
    _check_keys(name, table, accepted, required=("file",))
    for key in _FILES:
        if key in table and not (isinstance(table[key], str) and table[key] and "\0" not in table[key]):
            raise TypeError(f"{name}.{key}: expected a file's name, got {describe_value(table[key])}")
    known: dict[str, Any] = {key: table.get(key) for key in _FILES}
    known["stamp"] = check_stamp(f"{name}.stamp", table.get("stamp"))
    if "turntable_deg" not in table:
        return RecordedView(pose=_parse_pose(name, table), **known)
    if set(table) - set(known) != {"turntable_deg"}:
        raise ValueError(f"{name}: expected one pose, got turntable_deg and another one")
    if turntable is None:
        raise ValueError(f"{name}: turntable_deg needs a [turntable] table with the camera's pose at angle 0")
    _check_keys("turntable", turntable, accepted=("pose", "angles_deg", "origin", "center", "axis"))
    pose = turntable_pose(
        _parse_pose("turntable", turntable),
        math.radians(_parse_number(f"{name}.turntable_deg", table["turntable_deg"])),
        _parse_numbers("turntable.center", turntable.get("center", [0.0, 0.0, 0.0])),
        _parse_numbers("turntable.axis", turntable.get("axis", [0.0, 0.0, 1.0])),
    )
    return RecordedView(pose=pose, **known)


def _parse_pose(name: str, table: Mapping[str, Any]) -> Array:
    """Return the pose of a table that has either `pose`, or `angles_deg` and `origin`."""
    given = {"pose", "angles_deg", "origin"} & set(table)
    if given == {"pose"}:
        return check_rigid_motion(f"{name}.pose", _parse_numbers(f"{name}.pose", table["pose"]))
    if given == {"angles_deg", "origin"}:
        angles = _parse_numbers(f"{name}.angles_deg", table["angles_deg"])
        if angles.shape != (3,):
            raise ValueError(f"{name}.angles_deg: expected three angles, got {describe_value(angles)}")
        rx, ry, rz = np.radians(angles).tolist()
        return pose_from_angles(rx, ry, rz, _parse_numbers(f"{name}.origin", table["origin"]))
    raise ValueError(
        f"{name}: expected either pose (4 x 4, camera to world), or angles_deg and origin, or, in a view, "
        f"turntable_deg; got {', '.join(sorted(given)) or 'none of them'}"
    )


def _check_keys(name: str, table: Any, accepted: Collection[str], required: Collection[str] = ()) -> None:
    if not isinstance(table, Mapping):
        raise TypeError(f"{name}: expected a table, got {describe_value(table)}")
    unknown = sorted(set(table) - set(accepted))
    if unknown:
        raise ValueError(f"{name}: unknown key {', '.join(unknown)}; accepted are {', '.join(accepted)}")
    missing = [key for key in required if key not in table]
    if missing:
        raise ValueError(f"{name}: missing key {', '.join(missing)}")


def _parse_number(name: str, value: Any) -> float:
    try:
        return check_number(name, value)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected a finite number, got {describe_value(value)}") from error


def _parse_numbers(name: str, value: Any) -> Array:
    """Return nested lists of numbers as floats; in TOML, some may be whole."""
    try:
        array = np.asarray(value)
    except ValueError:  # rows of different lengths
        array = np.empty(0, dtype=object)
    if not isinstance(value, list) or array.dtype.kind not in "iuf":
        raise TypeError(f"{name}: expected a list of numbers, got {describe_value(value)}")
    return array.astype(np.float64)
