"""Pair depth images with colour images while a recording is read."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator

from strand.io.recordings.bags import Message

_DELAY = 10**9  # nanoseconds between the recordings of a pair, at most


def pair_colors(
    messages: Iterator[Message],
    topic: str,
    wanted: range,
    read_stamp: Callable[[Message], int],
    tolerance: int,
    max_bytes: int,
) -> Iterator[tuple[int, Message, Message | None]]:
    """Yield depth messages with their numbers, and the nearest colour message in time of each.

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
        Memory limit for colour messages that wait for their depth; the oldest are dropped.
    """
    number = 0
    waiting: deque[tuple[int, Message, int]] = deque()
    colors: deque[tuple[int, Message]] = deque()
    held = 0

    def take(first: tuple[int, Message, int]) -> tuple[int, Message, Message | None]:
        nearest = min(colors, key=lambda color: abs(color[0] - first[2]), default=None)
        near = nearest is not None and abs(nearest[0] - first[2]) <= tolerance
        return first[0], first[1], nearest[1] if near and nearest is not None else None

    for message in messages:
        if message.topic == topic:
            if number in wanted:
                waiting.append((number, message, read_stamp(message)))
            number += 1
        else:
            colors.append((read_stamp(message), message))
            held += len(message.data)
        newest = colors[-1][0] if colors else None
        while waiting and (
            (newest is not None and newest >= waiting[0][2])
            or message.time > waiting[0][1].time + tolerance + _DELAY
        ):
            yield take(waiting.popleft())
        oldest = (waiting[0][1] if waiting else message).time - tolerance - _DELAY
        while colors and (colors[0][1].time < oldest or (held > max_bytes and len(colors) > 1)):
            held -= len(colors.popleft()[1].data)
        if not waiting and number > wanted[-1]:
            return
    while waiting:
        yield take(waiting.popleft())
