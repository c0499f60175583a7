"""The settings of a batch: facts about all recordings, how to read them, and a digest."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand.config import Config
from strand.io.budget import MAX_BYTES
from strand.io.recordings.recording import TOLERANCE
from strand.io.single_view import KnownCamera
from strand.reconstruction.evidence.prior import Prior, check_branches
from strand.ropes.netlist import Netlist
from strand.support.checks import (
    check_bool,
    check_integer,
    check_intrinsics,
    check_lengths,
    check_nonnegative,
    check_positive,
    check_sequence,
    check_small_array,
    check_text,
    freeze_array,
)
from strand.support.files import convert_to_json
from strand.support.lazy import lazy_property
from strand.tracking.settings import check_settings
from strand.views.box import Bounds, make_box

RATE = 30.0  # frames per second of folders, which have no times

# what makes no sense with a tracker, and why
_NOT_TRACKED = {
    "deadline": "a tracker has none",
    "stretch": "a tracker goes through whole recordings",
    "viewpoint": "it is for files of points, and a tracker needs depth images",
    "camera_frame": "it is for files of points, and a tracker needs depth images",
    "branches": "a tracker follows ropes that do not branch",
}

DIGITS = 16
"""Number of hexadecimal digits of a digest in tables and file names."""


@dataclass(frozen=True, eq=False)
class Settings:
    """The settings of a batch: facts about all recordings, and how to read them.

    A scene's own radius and bounds apply where the settings have none.

    Parameters
    ----------
    radius, bounds, ropes, length, config, deadline, branches, wire
        As in `strand.reconstruct`. With a deadline, the rows depend on the machine's speed.
    every : int
        Step between the frames to take from recordings and folders of images; 1 takes every frame.
    stretch : int, optional
        Number of taken frames in a unit of work; by default a unit is a whole recording. With stretches, the
        batch opens each bag during the search to read its index. With `world` or several topics, each stretch
        first decodes all of a bag's messages; then give a tenth of its frames or more.
    track : bool
        Whether one `strand.Tracker` follows the ropes through the frames of each recording. A folder of
        scenes is then one recording, with a scene for each frame. `deadline`, `stretch`, `viewpoint`,
        `camera_frame` and `branches` do not go with it.
    rate : float, optional
        With `track`, frames per second of folders, which have no times; by default 30.
    topics, world, tolerance, ignore_distortion, color_topics
        For bags, as in `strand.Recording`.
    intrinsics : (3, 3) array_like, optional
        Pinhole matrix of bags, folders of images and single depth images, pixels.
    depth_scale : float, optional
        Metres per unit of whole-number depths, for the same inputs.
    viewpoint, camera_frame
        For single files of points, as in `strand.load_scene`.
    max_bytes, outside
        As in `strand.load_scene`, for each recording.

    Raises
    ------
    TypeError, ValueError
        If an argument has the wrong type or is out of range.
    """

    radius: float | Sequence[float] | None = None
    bounds: Bounds | None = None
    ropes: int | None = None
    length: float | Sequence[float] | None = None
    config: Config = field(default_factory=Config)
    deadline: float | None = None
    every: int = 1
    stretch: int | None = None
    track: bool = False
    rate: float | None = None
    topics: Sequence[str] | None = None
    world: str | None = None
    tolerance: float = TOLERANCE
    ignore_distortion: bool = False
    intrinsics: ArrayLike | None = None
    depth_scale: float | None = None
    viewpoint: ArrayLike | None = None
    camera_frame: bool = False
    color_topics: Sequence[str] | None = None
    max_bytes: int = MAX_BYTES
    outside: bool = False
    branches: bool | Netlist = False
    wire: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.config, Config):
            raise TypeError(f"config: expected a strand.Config, got {type(self.config).__name__}")
        KnownCamera(self.viewpoint, self.camera_frame, self.intrinsics, self.depth_scale)
        check_bool("ignore_distortion", self.ignore_distortion)
        check_bool("outside", self.outside)
        if check_bool("track", self.track):
            for name, why in _NOT_TRACKED.items():
                value = getattr(self, name)
                if value is not None and value is not False:
                    raise ValueError(f"{name}: not with track: {why}")
            check_settings(self.radius, self.ropes, self.length, None, self.config)
        elif self.rate is not None:
            raise ValueError("rate: only with track, for the times of folders")
        # equal settings get the same form, and so the same digest
        checked: dict[str, Any] = {
            "radius": _check_lengths("radius", self.radius),
            "bounds": None if self.bounds is None else make_box(self.bounds),
            "length": _check_lengths("length", self.length),
            "deadline": None if self.deadline is None else check_positive("deadline", self.deadline),
            "every": check_integer("every", self.every, 1),
            "stretch": None if self.stretch is None else check_integer("stretch", self.stretch, 1),
            "rate": check_positive("rate", RATE if self.rate is None else self.rate) if self.track else None,
            "world": None if self.world is None else check_text("world", self.world),
            "tolerance": check_nonnegative("tolerance", self.tolerance),
            "intrinsics": None
            if self.intrinsics is None
            else freeze_array(check_intrinsics("intrinsics", self.intrinsics)),
            "depth_scale": None
            if self.depth_scale is None
            else check_positive("depth_scale", self.depth_scale),
            "max_bytes": check_integer("max_bytes", self.max_bytes, 1),
        }
        for name in ("topics", "color_topics"):
            if (given := getattr(self, name)) is not None:
                listed = check_sequence(name, given, "text")
                checked[name] = tuple(check_text(name, topic) for topic in listed)
        if self.viewpoint is not None:
            checked["viewpoint"] = freeze_array(check_small_array("viewpoint", self.viewpoint, (3,)))
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        prior = Prior.from_caller(self.ropes, self.length, None)
        _, wire, _ = check_branches(self.branches, self.wire, self.config.method, prior)
        object.__setattr__(self, "wire", wire)

    def to_json(self) -> dict[str, Any]:
        """Return all settings in JSON's types, with the parameters of the method."""
        settings: dict[str, Any] = _name_infinite(convert_to_json(self))
        return settings

    @lazy_property
    def digest(self) -> str:
        """Digest of all settings, 16 hexadecimal digits, as in the column `configuration`."""
        return compute_digest(json.dumps(self.to_json(), sort_keys=True))


def _check_lengths(name: str, given: float | Sequence[float] | None) -> float | tuple[float, ...] | None:
    """Return one length or several, metres."""
    if given is None:
        return None
    values = check_lengths(name, given)
    return values if np.ndim(given) else values[0]


def _name_infinite(value: Any) -> Any:
    """Return a value in JSON's types with text for infinite numbers, which the sides of bounds may be."""
    if isinstance(value, dict):
        return {key: _name_infinite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_name_infinite(entry) for entry in value]
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def compute_digest(text: str) -> str:
    """Return the first 16 hexadecimal digits of a text's SHA-256."""
    return hashlib.sha256(text.encode("utf-8", "surrogateescape")).hexdigest()[:DIGITS]
