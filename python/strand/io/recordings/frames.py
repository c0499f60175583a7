"""The frames of a recording: the views of all cameras at one time, decoded or not."""

from __future__ import annotations

from dataclasses import dataclass

from strand.io.recordings.message import Message
from strand.support.stamps import SECOND
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class Frame:
    """The views of all cameras at one time.

    Attributes
    ----------
    number : int
        Number of the frame in the recording, from 0.
    stamp : int
        Time stamp of the first camera's message, nanoseconds since 1970.
    views : tuple of View
        One for each topic, in the order of `Recording.topics`, with their `stamp` in seconds.
    stamps : tuple of int
        Time stamp of each view's message, nanoseconds since 1970.
    """

    number: int
    stamp: int
    views: tuple[View, ...]
    stamps: tuple[int, ...]

    @property
    def time(self) -> float:
        """The time stamp, seconds since 1970."""
        return self.stamp / SECOND

    @property
    def times(self) -> tuple[float, ...]:
        """The time stamps of all views, seconds since 1970."""
        return tuple(stamp / SECOND for stamp in self.stamps)


@dataclass(frozen=True, eq=False)
class UndecodedFrame:
    """A frame whose messages are not decoded yet.

    Attributes
    ----------
    number : int
        Number of the frame in the recording, from 0.
    messages : tuple of Message
        One for each topic; none for a LeRobot data set, whose files have the images.
    colors : tuple of (Message or None)
        The colour image of each.
    held : int
        Memory of these and of other messages that wait meanwhile, bytes.
    """

    number: int
    messages: tuple[Message, ...]
    colors: tuple[Message | None, ...]
    held: int
