"""What the stages of both methods share: what they work on, what they find, progress, timings, warnings."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from strand._core import EndObservation
from strand.reconstruction.evidence.prior import Prior
from strand.reconstruction.radius import Radii
from strand.ropes.chain import Chain
from strand.ropes.doubt import Alternative, Doubt, Join, ModelWarning
from strand.support.checks import Array
from strand.support.lazy import lazy_property
from strand.views.box import Box
from strand.views.sensor import Sensor
from strand.views.view import View


@dataclass
class Run:
    """What a run gathers beside its result, and when it is to end.

    Attributes
    ----------
    progress : callable or None
        Is called with each stage's name when it starts.
    timings : dict of str to float
    warnings : list of ModelWarning
    deadline : float
        By `time.monotonic`; infinite for none.
    left_out : list of str
        What was not done for the deadline's sake, in words.
    """

    progress: Callable[[str], None] | None
    timings: dict[str, float] = field(default_factory=dict)
    warnings: list[ModelWarning] = field(default_factory=list)
    deadline: float = math.inf
    left_out: list[str] = field(default_factory=list)

    def late(self, what: str) -> bool:
        """Tell whether the deadline has passed, and note that `what` is left out then."""
        if time.monotonic() < self.deadline:
            return False
        if what not in self.left_out:
            self.left_out.append(what)
        return True

    def apart(self) -> Run:
        """Return a run with warnings of its own, for an answer that may not be taken."""
        return replace(self, warnings=[])

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage and time it; a stage that comes again adds to its time."""
        if self.progress is not None:
            self.progress(name)
        start = time.perf_counter()
        yield
        self.timings[name] = self.timings.get(name, 0.0) + time.perf_counter() - start


@dataclass(frozen=True, eq=False)
class Observed:
    """What a method works on: the views that see something, and what is known beforehand.

    Attributes
    ----------
    views : tuple of View
        Cropped and without outliers.
    whole : tuple of View
        The same views with all that they saw, beyond the ropes too.
    numbers : tuple of int
        What each is called in warnings.
    bounds : Box or None
        The extraction range that the views were cropped to, metres.
    radii : Radii
    prior : Prior
    middle : int or None
        The number of the view whose pose is held, or of one near it; None: the middle one.
    """

    views: Sequence[View]
    whole: Sequence[View]
    numbers: Sequence[int]
    bounds: Box | None
    radii: Radii
    prior: Prior
    middle: int | None = None

    @lazy_property
    def masked(self) -> list[bool]:
        """Which views have a mask; one of everything is none."""
        return [view.mask is not None and not view.mask.all() for view in self.whole]

    @property
    def held(self) -> int:
        """The place of the view whose pose is held."""
        if self.middle is None:
            return len(self.views) // 2
        middle = self.middle
        return min(range(len(self.views)), key=lambda place: abs(self.numbers[place] - middle))


@dataclass(frozen=True, eq=False)
class Found:
    """What a method finds in the views that see something.

    Attributes
    ----------
    chains : list of Chain
        Longest first.
    poses : list of (4, 4) ndarray
        Registered camera-to-world poses of these views.
    pose_sd : list of (6,) ndarray
        Standard deviations of the corrections: rotation vector, radians, and translation, metres; NaN where
        the method knows none.
    stages : dict of str to object
        The arrays between the stages.
    joins : tuple of Join
        The least certain first.
    doubts : tuple of Doubt or None
        What speaks against the answer; None if the method does not say.
    alternatives : tuple of Alternative
        Other answers, the best first.
    sensor : Sensor or None
        The sensor's errors as measured; None if the method does not.
    ends : tuple of EndObservation
        Where views saw the curves of the "fit" end, if the method asks each.
    branch : str or None
        The branch of the default method that found the chains, as in `Model.branch`.
    all_rings : bool
        Whether the method was told that all ropes are rings.
    """

    chains: list[Chain]
    poses: list[Array]
    pose_sd: list[Array]
    stages: dict[str, Any]
    joins: tuple[Join, ...] = ()
    doubts: tuple[Doubt, ...] | None = None
    alternatives: tuple[Alternative, ...] = ()
    sensor: Sensor | None = None
    ends: tuple[EndObservation, ...] = ()
    branch: str | None = None
    all_rings: bool = False
