"""Read the messages of MCAP files, with an index or without, in the order of time."""

from __future__ import annotations

import heapq
from array import array
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np

from strand.io.recordings.mcap_layout import read_layout
from strand.io.recordings.mcap_records import BODY, STAMPED, Chunk, read_chunk, walk_records
from strand.io.recordings.message import Message
from strand.io.recordings.unpacking import Limits, Work
from strand.support.files import open_file
from strand.support.mcap_format import MESSAGE, RECORD


class McapFile:
    """An open MCAP file; ValueError is raised where it is damaged, or needs more than its limits.

    Attributes
    ----------
    topics : dict of str to str
        The type of each topic's messages.
    counts : dict of str to int
        The number of messages of each topic.
    span : (int, int) or None
        Times of the first and the last message, nanoseconds since 1970; None without a message.
    """

    def __init__(self, path: Path, limits: Limits) -> None:
        self._file, self._limits = open_file(path), limits
        try:
            self._layout = read_layout(self._file, path, limits)
        except BaseException:
            self._file.close()
            raise
        self.span = self._layout.span
        self.topics = {one.topic: one.kind for one in self._layout.channels.values()}
        self.counts = dict.fromkeys(self.topics, 0)
        for number, one in self._layout.channels.items():
            self.counts[one.topic] += self._layout.counts.get(number, 0)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read_messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording.

        `topics` may lose entries meanwhile; chunks that only these are in are not read any more. A chunk is
        in memory from the time of its first message to that of its last.
        """
        work = self._limits.begin_pass(self._layout.size)
        opened: dict[int, _OpenChunk] = {}
        order: list[tuple[int, int]] = []  # a heap of the next time, and the number, of each open chunk
        wanted, known = _Wanted(frozenset()), -1
        following = [*(chunk.start for chunk in self._layout.chunks[1:]), None]
        for number, (chunk, end) in enumerate(zip(self._layout.chunks, following, strict=True)):
            if len(topics) != known:
                channels = self._layout.channels.items()
                wanted, known = _Wanted({key for key, one in channels if one.topic in topics}), len(topics)
            if wanted.has_any(chunk):
                opened[number] = self._open(chunk, wanted, work)
                self._put(number, opened, order)
            while order and (end is None or order[0][0] < end):
                time, first = heapq.heappop(order)
                yield from self._take(opened[first], topics, time)
                self._put(first, opened, order)

    def read_firsts(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the first message of each topic, in the order of recording."""
        left = {topic for topic in topics if self.counts.get(topic)}
        for message in self.read_messages(left):
            left.discard(message.topic)
            yield message
            if not left:
                return

    def _open(self, chunk: Chunk, wanted: _Wanted, work: Work) -> _OpenChunk:
        data = read_chunk(self._file, chunk, self._layout.size, self._limits)
        return _OpenChunk(data, chunk, wanted.channels, work)

    @staticmethod
    def _put(number: int, opened: dict[int, _OpenChunk], order: list[tuple[int, int]]) -> None:
        """Put a chunk where its next message is due, or drop it at its end."""
        time = opened[number].time
        if time is None:
            del opened[number]
        else:
            heapq.heappush(order, (time, number))

    def _take(self, opened: _OpenChunk, topics: Collection[str], time: int) -> Iterator[Message]:
        """Yield the next message of a chunk, if its topic is still wanted."""
        key, data = opened.take()
        one = self._layout.channels[key]
        if one.topic in topics:
            if one.encoding != "cdr":
                raise ValueError(f"{one.topic}: expected messages in CDR, got {one.encoding[:40]!r}")
            self._limits.check_message(len(data))
            yield Message(one.topic, one.kind, time, bytes(data))


class _Wanted:
    """Channels whose messages are wanted."""

    def __init__(self, channels: Collection[int]) -> None:
        self.channels = channels
        self._marks = np.zeros(1 << 16, dtype=bool)
        self._marks[list(channels)] = True

    def has_any(self, chunk: Chunk) -> bool:
        """Tell whether a chunk may have one of the channels."""
        if chunk.channels is None:
            return bool(self.channels)
        return bool(self._marks[np.frombuffer(chunk.channels, dtype=np.uint16)].any())


class _OpenChunk:
    """A decompressed chunk, and the places of the messages that are still to come, in the order of time."""

    def __init__(self, data: memoryview, chunk: Chunk, wanted: Collection[int], work: Work) -> None:
        self._data, self._next = data, 0
        places, times = array("I"), array("Q")
        for kind, start, stop in walk_records(data, work):
            if kind != MESSAGE or stop - start < BODY:
                continue
            _, _, channel, _, time = STAMPED.unpack_from(data, start - RECORD.size)
            if channel in wanted:
                if not chunk.start <= time <= chunk.end:
                    raise ValueError(f"a message at {time} ns, outside of its chunk's times")
                places.append(start - RECORD.size)
                times.append(time)
        ordered = np.argsort(np.frombuffer(times, dtype=np.uint64), kind="stable")
        self._places = np.frombuffer(places, dtype=np.uint32)[ordered]

    @property
    def time(self) -> int | None:
        """Time of the next message; None at the end."""
        if self._next == len(self._places):
            return None
        return int(STAMPED.unpack_from(self._data, int(self._places[self._next]))[4])

    def take(self) -> tuple[int, memoryview]:
        """Return the channel and the data of the next message."""
        place = int(self._places[self._next])
        self._next += 1
        _, size, channel, _, _ = STAMPED.unpack_from(self._data, place)
        start = place + RECORD.size
        return channel, self._data[start + BODY : start + size]
