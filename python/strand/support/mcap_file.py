"""Write an MCAP file of messages, with an index, without another package."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from struct import Struct
from typing import BinaryIO
from zlib import crc32

from strand.support.mcap_format import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    RECORD,
    SCHEMA,
    STATISTICS,
)

_CHUNK_BYTES = 1 << 20  # of messages, from which on a chunk is written
_LENGTH = Struct("<I")  # of a text, a list or a map
_CHANNEL_HEAD = Struct("<HH")  # number, and that of the schema
_MESSAGE_HEAD = Struct("<HIQQ")  # channel, number, times of recording and of publication
_CHUNK_PLACE = Struct("<QQQQ")  # the same times, place, bytes of its record
_ENTRY = Struct("<QQ")  # two long numbers
_COUNT = Struct("<HQ")  # a channel and a long number
_STATISTICS_HEAD = Struct("<QHIIIIQQ")  # messages, schemas, channels, two more counts, chunks, times


@dataclass(frozen=True)
class Channel:
    """A topic, the type of its messages, and its schema; encodings are those of messages and schema."""

    topic: str
    kind: str
    schema: bytes
    encoding: str = "json"
    schema_encoding: str = "jsonschema"


class McapFile:
    """An MCAP file that is being written; chunks are not compressed.

    Parameters
    ----------
    file : binary file
        An empty one.
    channels : sequence of Channel
    library : str
        The name of the writing program.
    profile : str
        What the messages are, such as "ros2".
    """

    def __init__(self, file: BinaryIO, channels: Sequence[Channel], library: str, profile: str = "") -> None:
        self._file, self._place = file, 0
        self._names = b"".join(_pack_channel(number, one) for number, one in enumerate(channels, 1))
        self._messages = bytearray()
        self._entries: list[list[tuple[int, int]]] = [[] for _ in channels]
        self._index, self._times = list[bytes](), list[int]()
        self._counts = [0] * len(channels)
        self._write(MAGIC, _pack(HEADER, _frame(profile.encode()), _frame(library.encode())), self._names)

    def add(self, time: int, data: bytes, channel: int = 0) -> None:
        """Add a message to a channel, by its place in `channels`; `time` is in nanoseconds."""
        self._entries[channel].append((time, len(self._messages)))
        head = _MESSAGE_HEAD.pack(channel + 1, self._counts[channel] & 0xFFFFFFFF, time, time)
        self._messages += _pack(MESSAGE, head, data)
        self._counts[channel] += 1
        if len(self._messages) >= _CHUNK_BYTES:
            self._end_chunk()

    def end(self) -> None:
        """Write the rest: the last chunk and the index."""
        if self._messages:
            self._end_chunk()
        self._write(_pack(DATA_END, bytes(4)))
        start = self._place
        span = (min(self._times), max(self._times)) if self._times else (0, 0)
        number, total = len(self._counts), sum(self._counts)
        statistics = _STATISTICS_HEAD.pack(total, number, number, 0, 0, len(self._index), *span)
        counts = _frame(b"".join(_COUNT.pack(key, count) for key, count in enumerate(self._counts, 1)))
        summary = self._names + b"".join(self._index) + _pack(STATISTICS, statistics, counts)
        # no offsets of groups, no checksum
        self._write(summary, _pack(FOOTER, _ENTRY.pack(start, 0), bytes(4)), MAGIC)

    def _end_chunk(self) -> None:
        times = [time for entries in self._entries for time, _ in entries]
        span, data = (min(times), max(times)), bytes(self._messages)
        head = CHUNK_HEAD.pack(*span, len(data), crc32(data))
        chunk = _pack(CHUNK, head, _frame(b""), len(data).to_bytes(8, "little"), data)
        index, places = b"", b""
        for number, entries in enumerate(self._entries, 1):
            if entries:
                listed = b"".join(_ENTRY.pack(*entry) for entry in entries)
                places += _COUNT.pack(number, self._place + len(chunk) + len(index))
                index += _pack(MESSAGE_INDEX, number.to_bytes(2, "little"), _frame(listed))
        self._index.append(
            _pack(
                CHUNK_INDEX,
                _CHUNK_PLACE.pack(*span, self._place, len(chunk)),
                _frame(places),
                len(index).to_bytes(8, "little"),
                _frame(b""),
                _ENTRY.pack(len(data), len(data)),
            )
        )
        self._times += span
        self._write(chunk, index)
        self._messages.clear()
        for entries in self._entries:
            entries.clear()

    def _write(self, *parts: bytes) -> None:
        for part in parts:
            self._file.write(part)
            self._place += len(part)


def _pack_channel(number: int, channel: Channel) -> bytes:
    """Return the records of a channel's schema and of the channel."""
    names = (channel.kind.encode(), channel.schema_encoding.encode(), channel.schema)
    return _pack(SCHEMA, number.to_bytes(2, "little"), *map(_frame, names)) + _pack(
        CHANNEL,
        _CHANNEL_HEAD.pack(number, number),
        _frame(channel.topic.encode()),
        _frame(channel.encoding.encode()),
        _frame(b""),
    )


def _pack(kind: int, *parts: bytes) -> bytes:
    """Return a record."""
    return b"".join((RECORD.pack(kind, sum(map(len, parts))), *parts))


def _frame(data: bytes) -> bytes:
    """Return bytes after their length."""
    return _LENGTH.pack(len(data)) + data
