"""Data that the stages of both methods share: their input, their answer, progress, timings, warnings."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from strand._core import EndObservation
from strand.geometry.plane import Plane
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.radius import Radii
from strand.ropes.chain import Chain
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.support.checks import Array
from strand.support.lazy import lazy_property
from strand.views.box import Box
from strand.views.depth_image import DepthImage
from strand.views.extract import Extract
from strand.views.rope_images import make_rope_images
from strand.views.sensor import Sensor
from strand.views.view import View

_MARGIN = 2.0  # radii outside the extraction range: noise moves depths of ropes that far


@dataclass
class Run:
    """The progress, timings, warnings and deadline of a run.

    Attributes
    ----------
    progress : callable or None
        Called with the name of each stage when it starts.
    timings : dict of str to float
        Seconds of each stage.
    warnings : list of ModelWarning
    deadline : float
        By `time.monotonic`; infinite for none.
    skipped : list of str
        Names of the work that was skipped after the deadline.
    """

    progress: Callable[[str], None] | None
    timings: dict[str, float] = field(default_factory=dict)
    warnings: list[ModelWarning] = field(default_factory=list)
    deadline: float = math.inf
    skipped: list[str] = field(default_factory=list)

    def skips(self, work: str) -> bool:
        """Tell whether the deadline has passed, and note that the named work is skipped then."""
        if time.monotonic() < self.deadline:
            return False
        if work not in self.skipped:
            self.skipped.append(work)
        return True

    def warn(
        self,
        kind: str,
        message: str,
        place: Array | None = None,
        amount: float | None = None,
        chains: tuple[int, ...] = (),
        view: int | None = None,
    ) -> None:
        """Add a `ModelWarning`."""
        self.warnings.append(ModelWarning(kind, message, place, amount, chains, view))

    def fork(self) -> Run:
        """Return the run with warnings of its own, for an answer that may be dropped."""
        return replace(self, warnings=[])

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage and time it. The times of stages with the same name add up."""
        if self.progress is not None:
            self.progress(name)
        start = time.perf_counter()
        yield
        self.timings[name] = self.timings.get(name, 0.0) + time.perf_counter() - start


@dataclass(frozen=True, eq=False)
class Observed:
    """The input of a method: the views that show ropes, and the caller's knowledge of the ropes.

    Attributes
    ----------
    views : sequence of View
        Cropped and without outliers.
    whole : sequence of View
        The same views, uncropped.
    numbers : sequence of int
        The number of each in the caller's views.
    bounds : Box or None
        The extraction range that the views were cropped to, metres.
    radii : Radii
    prior : Prior
    middle : int or None
        The number of the view whose pose is held, or of one near it; None: the middle one.
    pictures : mapping of int to DepthImage
        Images made of clouds on a table, with a mask of their ropes, by the number of the view.
    support : (normal, offset) or None
        The plane that flat ropes seem to lie on, if views show ropes alone: normal @ x = offset, metres.
    masks_found : bool
        Whether strand found the masks, in which bits of other things are left.
    """

    views: Sequence[View]
    whole: Sequence[View]
    numbers: Sequence[int]
    bounds: Box | None
    radii: Radii
    prior: Prior
    middle: int | None = None
    pictures: Mapping[int, DepthImage] = field(default_factory=dict)
    support: tuple[Array, float] | None = None
    masks_found: bool = False

    @property
    def radius(self) -> float:
        """The least radius, metres."""
        return float(self.radii.values[0])

    @lazy_property
    def masked(self) -> list[bool]:
        """Whether each view has a mask that excludes some pixels."""
        return [view.mask is not None and not view.mask.all() for view in self.whole]

    @property
    def extract(self) -> Extract:
        """The views, whole and inside the extraction range."""
        return Extract(tuple(self.whole), self.bounds, tuple(self.views))

    @lazy_property
    def images(self) -> list[DepthImage]:
        """Each view's image with a mask of its ropes."""
        return make_rope_images(self.views, self.whole, self.bounds, _MARGIN * self.radius)

    @property
    def held(self) -> int:
        """The place of the view whose pose is held."""
        if self.middle is None:
            return len(self.views) // 2
        middle = self.middle
        return min(range(len(self.views)), key=lambda place: abs(self.numbers[place] - middle))


class SoughtTable(NamedTuple):
    """The table beside ropes of a radius, metres, in an image, world frame; None if it shows none."""

    image: DepthImage
    radius: float
    table: Plane | None

    def holds_for(self, image: DepthImage, radius: float) -> bool:
        """Tell whether the table beside ropes of a radius, metres, is the same in another image."""
        own = self.image
        if image.depth is not own.depth or image.camera != own.camera or radius != self.radius:
            return False
        pairs = ((image.pose, own.pose), (image.mask, own.mask))
        return all(one is other or np.array_equal(one, other) for one, other in pairs)


@dataclass(frozen=True, eq=False)
class Found:
    """The answer of a method for the views that show ropes.

    Attributes
    ----------
    chains : list of Chain
        Longest first.
    poses : list of (4, 4) ndarray
        Registered camera-to-world poses of these views.
    pose_sd : list of (6,) ndarray
        Standard deviations of the corrections: rotation vector, radians, and translation, metres; NaN where
        they are not known.
    stages : dict of str to object
        The arrays between the stages.
    joins : tuple of Join
        The least certain first.
    doubts : tuple of Doubt or None
        The evidence against the answer; None if the method finds no doubts.
    alternatives : tuple of Alternative
        Other answers, the best first.
    branch : str or None
        As `Model.branch`.
    sensor : Sensor or None
        The sensor's errors as measured; None if the method does not measure them.
    ends : tuple of EndObservation
        Where views show the ends of the curves of "fit".
    all_rings : bool
        Whether the method took all ropes for rings, as the caller said.
    sought : SoughtTable or None
        The table beside the ropes, if the method sought it.
    """

    chains: list[Chain]
    poses: list[Array]
    pose_sd: list[Array]
    stages: dict[str, Any]
    joins: tuple[Join, ...] = ()
    doubts: tuple[Doubt, ...] | None = None
    alternatives: tuple[Alternative, ...] = ()
    branch: str | None = None
    sensor: Sensor | None = None
    ends: tuple[EndObservation, ...] = ()
    all_rings: bool = False
    sought: SoughtTable | None = None
