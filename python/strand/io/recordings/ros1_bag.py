"""Read the messages of ROS 1 bags in the order of time, by their index."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Collection, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from strand.io.recordings.message import Message
from strand.io.recordings.ros1_index import read_index
from strand.io.recordings.ros1_records import find_message
from strand.io.recordings.unpacking import Limits, Work, unpack
from strand.support.files import open_file

_KEPT = 4  # decompressed chunks in memory, at most


class Ros1Bag:
    """An open ROS 1 bag; ValueError is raised where it is damaged, or needs more than its limits.

    Attributes
    ----------
    topics : dict of str to str
        The type of each topic's messages, by its name in ROS 2.
    counts : dict of str to int
        The number of messages of each topic.
    span : (int, int) or None
        Times of the first and the last message, nanoseconds since 1970; None without a message.
    """

    def __init__(self, path: Path, limits: Limits) -> None:
        self._file, self._limits = open_file(path), limits
        try:
            self._index = read_index(self._file, path, limits)
        except BaseException:
            self._file.close()
            raise
        times, connections = self._index.times, self._index.connections
        self.topics = {one.topic: one.kind for one in connections.values()}
        self.counts = dict.fromkeys(self.topics, 0)
        keys, counts = np.unique(self._index.keys, return_counts=True)
        for key, count in zip(keys.tolist(), counts.tolist(), strict=True):
            self.counts[connections[key].topic] += count
        self.span = (int(times[0]), int(times[-1])) if len(times) else None

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read_messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording."""
        keys = [key for key, one in self._index.connections.items() if one.topic in topics]
        yield from self._read(np.flatnonzero(np.isin(self._index.keys, keys)))

    def read_firsts(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the first message of each topic, in the order of the file."""
        keys, numbers = np.unique(self._index.keys, return_index=True)
        firsts: dict[str, int] = {}
        for key, number in zip(keys.tolist(), numbers.tolist(), strict=True):
            topic = self._index.connections[key].topic
            if topic in topics:
                firsts[topic] = min(number, firsts.get(topic, number))
        wanted = np.array(list(firsts.values()), dtype=np.int64)
        yield from self._read(wanted[np.argsort(self._index.numbers[wanted], kind="stable")])

    def _read(self, wanted: NDArray[np.int64]) -> Iterator[Message]:
        """Yield messages by their numbers; a few chunks are kept, as messages of two may alternate."""
        work = self._limits.begin_pass(self._index.size)
        left = sum(chunk.size for chunk in self._index.chunks)
        kept: OrderedDict[int, memoryview] = OrderedDict()
        for number in wanted.tolist():
            message = self._read_message(number, kept, work)
            left -= len(message.data)
            if left < 0:
                raise ValueError("messages lie within others")
            yield message

    def _read_message(self, number: int, kept: OrderedDict[int, memoryview], work: Work) -> Message:
        index = self._index
        key, time = int(index.keys[number]), int(index.times[number])
        chunk = self._read_chunk(int(index.numbers[number]), kept, work)
        fields, data = find_message(chunk, int(index.places[number]))
        if (fields.get_number("conn", 4), fields.get_time("time")) != (key, time):
            raise ValueError("the index and a message differ")
        one = index.connections[key]
        self._limits.check_message(len(data))
        return Message(one.topic, one.kind, time, bytes(data))

    def _read_chunk(self, number: int, kept: OrderedDict[int, memoryview], work: Work) -> memoryview:
        """Return a decompressed chunk; the oldest that do not fit beside it are dropped."""
        if number not in kept:
            chunk = self._index.chunks[number]
            while kept and (
                len(kept) == _KEPT or chunk.size + sum(map(len, kept.values())) > self._limits.max_bytes
            ):
                kept.popitem(last=False)
            work.unpack(chunk.size)
            self._file.seek(chunk.place)
            kept[number] = unpack(chunk.kind, self._file, chunk.packed, chunk.size)
        kept.move_to_end(number)
        return kept[number]
