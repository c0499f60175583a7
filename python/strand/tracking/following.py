"""Follow ropes through a source of frames: a recording, a list, or a camera."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence

from strand.tracking.track import Track
from strand.tracking.tracker import Tracker
from strand.views.view import View

Shown = tuple[Sequence[View | None], float | Sequence[float] | None]
"""The views of one time, and the time or that of each view, s: the arguments of `Tracker.update`."""


def follow(tracker: Tracker, frames: Iterable[Shown] | Callable[[], Shown | None]) -> Iterator[Track]:
    """Yield the answer of a tracker for each frame.

    Parameters
    ----------
    tracker : Tracker
    frames : iterable of (views, time), or callable
        Views and time as for `Tracker.update`. A callable, as of a live camera, returns the next frame, and
        None at the end.

    Yields
    ------
    Track

    Raises
    ------
    TypeError, ValueError
        As `Tracker.update` does.
    """
    for views, time in iter(frames, None) if callable(frames) else frames:
        yield tracker.update(views, time)
