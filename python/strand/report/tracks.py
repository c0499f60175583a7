"""The answers of a tracker, as pictures of them need them: `strand.Tracker.update` returns such."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from strand.support.checks import Array


class TrackedRope(Protocol):
    """A rope at a time."""

    @property
    def number(self) -> int:
        """The same for the same rope."""

    @property
    def state(self) -> str:
        """How sure its place is, in a word."""

    @property
    def points(self) -> Array:
        """(M, 3) Nodes, world frame, metres."""

    @property
    def radius(self) -> float:
        """Metres."""

    @property
    def length(self) -> float:
        """Metres."""

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """(M,) Whether nothing shows a node."""


class Track(Protocol):
    """The ropes at a time, and what happened to them since the time before."""

    @property
    def time(self) -> float:
        """Seconds."""

    @property
    def ropes(self) -> Sequence[TrackedRope]:
        """In the order of their numbers."""

    @property
    def events(self) -> Sequence[Any]:
        """Each has `time` and `rope`, and is text by `str`."""

    @property
    def up(self) -> Array:
        """(3,) Unit vector up from the table, world frame."""


def name_rope(rope: TrackedRope) -> str:
    """Return a rope's number and length in words."""
    return f"rope {rope.number}: {1e3 * rope.length:.0f} mm"
