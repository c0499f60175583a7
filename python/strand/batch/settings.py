"""Settings: what is known of all recordings of a batch, and how they are read; their digest."""

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
from strand.reconstruction.evidence.prior import Prior
from strand.support.checks import (
    check_bool,
    check_integer,
    check_intrinsics,
    check_nonnegative,
    check_positive,
    check_sequence,
    check_small_array,
    check_text,
    freeze_array,
)
from strand.support.files import convert_to_json
from strand.support.lazy import lazy_property
from strand.views.box import Bounds, extraction_range

DIGITS = 16
"""How many hexadecimal digits a digest has in tables and names."""


@dataclass(frozen=True, eq=False)
class Settings:
    """What is known of all recordings of a batch, and how they are read.

    What a recording says of itself (a scene's radius and bounds) holds where nothing is given here.

    Parameters
    ----------
    radius, bounds, ropes, length, config, deadline
        As `strand.reconstruct` takes them. With a deadline rows depend on the machine's speed.
    every : int
        Of recordings and folders of images each so-manieth frame is taken, from the first on.
    stretch : int, optional
        How many frames, of those that are taken, a unit of work has; a whole recording if not given. Where it
        is given, whoever lists the recordings opens each bag to read its index. Each stretch decodes all of a
        bag's messages first if there is `world` or several topics: give a tenth of its frames or more then.
    topics, world, tolerance, ignore_distortion
        Of bags, as `strand.Recording` takes them.
    intrinsics : (3, 3) array_like, optional
        Of bags, folders of images and single depth images: the pinhole matrix, pixels.
    depth_scale : float, optional
        Of the same: metres for each unit of whole numbers.
    viewpoint, camera_frame
        Of single files of points, as `strand.load_scene` takes them.
    max_bytes, outside
        As `strand.load_scene` takes them, for each recording.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of range.
    """

    radius: float | Sequence[float] | None = None
    bounds: Bounds | None = None
    ropes: int | None = None
    length: float | Sequence[float] | None = None
    config: Config = field(default_factory=Config)
    deadline: float | None = None
    every: int = 1
    stretch: int | None = None
    topics: Sequence[str] | None = None
    world: str | None = None
    tolerance: float = TOLERANCE
    ignore_distortion: bool = False
    intrinsics: ArrayLike | None = None
    depth_scale: float | None = None
    viewpoint: ArrayLike | None = None
    camera_frame: bool = False
    max_bytes: int = MAX_BYTES
    outside: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.config, Config):
            raise TypeError(f"config: expected a strand.Config, got {type(self.config).__name__}")
        KnownCamera(self.viewpoint, self.camera_frame, self.intrinsics, self.depth_scale)
        check_bool("ignore_distortion", self.ignore_distortion)
        check_bool("outside", self.outside)
        # in one form, however they are given: their digest says whether two are the same
        checked: dict[str, Any] = {
            "radius": _lengths("radius", self.radius),
            "bounds": None if self.bounds is None else extraction_range(self.bounds),
            "length": _lengths("length", self.length),
            "deadline": None if self.deadline is None else check_positive("deadline", self.deadline),
            "every": check_integer("every", self.every, 1),
            "stretch": None if self.stretch is None else check_integer("stretch", self.stretch, 1),
            "world": None if self.world is None else check_text("world", self.world),
            "tolerance": check_nonnegative("tolerance", self.tolerance),
            "intrinsics": None
            if self.intrinsics is None
            else freeze_array(check_intrinsics("intrinsics", self.intrinsics)),
            "depth_scale": None if self.depth_scale is None else float(self.depth_scale),
            "max_bytes": check_integer("max_bytes", self.max_bytes, 1),
        }
        if self.topics is not None:
            given = check_sequence("topics", self.topics, "text")
            checked["topics"] = tuple(check_text("topics", one) for one in given)
        if self.viewpoint is not None:
            checked["viewpoint"] = freeze_array(check_small_array("viewpoint", self.viewpoint, (3,)))
        for name, value in checked.items():
            object.__setattr__(self, name, value)
        Prior.from_caller(self.ropes, self.length, None)

    @property
    def in_words(self) -> dict[str, Any]:
        """All of it in JSON's types, the numbers of the method too."""
        said: dict[str, Any] = _finite(convert_to_json(self))
        return said

    @lazy_property
    def digest(self) -> str:
        """16 hexadecimal digits of all of it: what the column `configuration` holds."""
        return digest_of(json.dumps(self.in_words, sort_keys=True))


def _lengths(name: str, given: float | Sequence[float] | None) -> float | tuple[float, ...] | None:
    """Return one length or several, metres."""
    if given is None:
        return None
    if isinstance(given, (int, float, np.number)) or (isinstance(given, np.ndarray) and given.ndim == 0):
        return check_positive(name, given)
    values = tuple(check_positive(name, one) for one in check_sequence(name, given, "numbers"))
    if not values:
        raise ValueError(f"{name}: expected a number or several, got none")
    return values


def _finite(value: Any) -> Any:
    """Return a value in JSON's types with text for what is infinite, as sides of bounds may be."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return str(value) if isinstance(value, float) and math.isinf(value) else value


def digest_of(words: str) -> str:
    """Return the first 16 hexadecimal digits of a text's SHA-256."""
    return hashlib.sha256(words.encode("utf-8", "surrogateescape")).hexdigest()[:DIGITS]
