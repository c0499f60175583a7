"""What the stages of a reconstruction share: progress, timings, warnings."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from strand.model import Alternative, Chain, Doubt, Join
from strand.view import Array


@dataclass
class Run:
    """What a run gathers beside its result."""

    progress: Callable[[str], None] | None
    timings: dict[str, float] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Announce a stage and time it; a stage that comes again adds to its time."""
        if self.progress is not None:
            self.progress(name)
        start = time.perf_counter()
        yield
        self.timings[name] = self.timings.get(name, 0.0) + time.perf_counter() - start


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
    doubts : tuple of Doubt
        What speaks against the answer; empty where the method does not say.
    alternatives : tuple of Alternative
        Other answers, the best first.
    """

    chains: list[Chain]
    poses: list[Array]
    pose_sd: list[Array]
    stages: dict[str, Any]
    joins: tuple[Join, ...] = ()
    doubts: tuple[Doubt, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
