"""The answers of a tracker, as pictures of them need them: `strand.Tracker.update` returns such."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from strand.geometry.polyline import find_runs
from strand.support.checks import Array, check_instances, check_integer, check_sequence


@runtime_checkable
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
    def confidence(self) -> float:
        """Probability that the rope runs so; NaN if unknown."""

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """(M,) Whether nothing shows a node."""


@runtime_checkable
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


def cut_rope(rope: TrackedRope, predicted: bool) -> list[Array]:
    """Return the stretches that are predicted with the nodes beside them, or those that are not."""
    chosen = rope.predicted if predicted else ~rope.predicted
    beside = 1 if predicted else 0
    parts = (
        rope.points[max(start - beside, 0) : stop + beside] for start, stop in find_runs(np.asarray(chosen))
    )
    return [part for part in parts if len(part) > 1]


def check_tracks(
    tracks: Sequence[Track], numbers: Sequence[int] | None
) -> tuple[tuple[Track, ...], tuple[int, ...]]:
    """Return the answers of a tracker, and the numbers of their frames; by default from 0 on."""
    answers = check_instances("tracks", tracks, Track)  # type: ignore[type-abstract]
    if numbers is None:
        return answers, tuple(range(len(answers)))
    given = check_sequence("numbers", numbers, "whole numbers")
    if len(given) != len(answers):
        raise ValueError(f"numbers: expected one for each of {len(answers)} tracks, got {len(given)}")
    return answers, tuple(check_integer("numbers", number) for number in given)
