"""Pair depth images with colour images while a recording is read."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import deque
from collections.abc import Callable, Iterator

from strand.io.recordings.message import Message

_DELAY = 10**9  # nanoseconds between the recordings of a pair, at most
_MAX_COLORS = 4096  # colour messages that wait, at most


def pair_colors(
    messages: Iterator[Message],
    topic: str,
    wanted: range,
    read_stamp: Callable[[Message], int],
    tolerance: int,
    max_bytes: int,
) -> Iterator[tuple[int, Message, Message | None, int]]:
    """Yield depth messages with their numbers, the nearest colour message in time of each, and what waits.

    Parameters
    ----------
    messages : iterator of Message
        Of both topics, in the order of recording.
    topic : str
        The depth topic.
    wanted : range
        The numbers of the depth messages to yield.
    read_stamp : callable
        Returns a message's time stamp, nanoseconds.
    tolerance : int
        Largest difference in time of a pair, nanoseconds; depth without a colour as near has None.
    max_bytes : int
        Memory limit for messages that wait: above it, the oldest colours are dropped, and depth waits no
        longer. The last number of a yielded entry is the memory of all that wait.
    """
    number = held = 0
    waiting: deque[tuple[int, Message, int]] = deque()
    colors = _Colors()
    for message in messages:
        if message.topic == topic:
            if number in wanted:
                waiting.append((number, message, read_stamp(message)))
                held += message.size
            number += 1
        else:
            colors.add(read_stamp(message), message)
            held += message.size
        oldest = (waiting[0][1] if waiting else message).time - tolerance - _DELAY
        while colors.messages and (
            colors.messages[0].time < oldest
            or len(colors.messages) > _MAX_COLORS
            or (held > max_bytes and len(colors.messages) > 1)
        ):
            held -= colors.drop().size
        while waiting and (
            colors.reaches(waiting[0][2])
            or message.time > waiting[0][1].time + tolerance + _DELAY
            or held > max_bytes
        ):
            first, depth, stamp = waiting.popleft()
            yield first, depth, colors.find_nearest(stamp, tolerance), held
            held -= depth.size
        if not waiting and number > wanted[-1]:
            return
    while waiting:
        first, depth, stamp = waiting.popleft()
        yield first, depth, colors.find_nearest(stamp, tolerance), held
        held -= depth.size


class _Colors:
    """Colour messages that wait for their depth, in the order of their stamps."""

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self._stamps: list[int] = []

    def add(self, stamp: int, message: Message) -> None:
        """Add a message."""
        place = bisect_right(self._stamps, stamp)
        self._stamps.insert(place, stamp)
        self.messages.insert(place, message)

    def drop(self) -> Message:
        """Remove the message with the earliest stamp."""
        del self._stamps[0]
        return self.messages.pop(0)

    def reaches(self, stamp: int) -> bool:
        """Tell whether a message is as late as a stamp."""
        return bool(self._stamps) and self._stamps[-1] >= stamp

    def find_nearest(self, stamp: int, tolerance: int) -> Message | None:
        """Return the message nearest to a stamp, if one is near enough; of two, the earlier."""
        after = bisect_left(self._stamps, stamp)
        near = [k for k in (after - 1, after) if 0 <= k < len(self._stamps)]
        best = min(near, key=lambda k: abs(self._stamps[k] - stamp), default=None)
        if best is None or abs(self._stamps[best] - stamp) > tolerance:
            return None
        return self.messages[best]
