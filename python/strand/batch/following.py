"""The ropes of one recording, followed from frame to frame."""

from __future__ import annotations

from dataclasses import replace

from strand.batch.frames import FrameInput
from strand.batch.settings import Settings
from strand.tracking.masking import mask_ropes
from strand.tracking.track import Track
from strand.tracking.tracker import Tracker


class Follower:
    """Follows the ropes of a recording with one tracker, which begins with the first frame.

    Parameters
    ----------
    settings : Settings
        Those of a batch with `track`.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._tracker: Tracker | None = None

    def update(self, number: int, frame: FrameInput) -> Track:
        """Return the tracker's answer to the next frame, after `mask_frame`; an error changes nothing."""
        settings = self._settings
        if self._tracker is None:
            radius = frame.radius if settings.radius is None else settings.radius
            self._tracker = Tracker(radius, settings.ropes, settings.length, config=settings.config)
        return self._tracker.update(frame.views, find_times(number, frame, settings))


def mask_frame(frame: FrameInput, settings: Settings) -> FrameInput:
    """Return a frame with masks that end at the bounds; without bounds, the tracker finds ropes by itself."""
    bounds = frame.bounds if settings.bounds is None else settings.bounds
    if bounds is None:
        return frame
    radius = frame.radius if settings.radius is None else settings.radius
    return replace(frame, views=mask_ropes(frame.views, radius, bounds))


def find_times(number: int, frame: FrameInput, settings: Settings) -> tuple[float, ...]:
    """Return the time of each view of a frame, s: since 1970, or since a folder's first frame."""
    if frame.times is not None:
        return frame.times
    assert settings.rate is not None
    return (number / settings.rate,) * len(frame.views)
