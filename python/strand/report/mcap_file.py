"""Write an MCAP file of JSON messages on one topic, with an index, without another package."""

from __future__ import annotations

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

_NUMBER = 1  # of the only schema, and of the only channel
_CHUNK_BYTES = 1 << 20  # of messages, from which on a chunk is written
_LENGTH = Struct("<I")  # of a text, a list or a map
_CHANNEL_HEAD = Struct("<HH")  # number, and that of the schema
_MESSAGE_HEAD = Struct("<HIQQ")  # channel, number, times of recording and of publication
_CHUNK_PLACE = Struct("<QQQQ")  # the same times, place, bytes of its record
_ENTRY = Struct("<QQ")  # two long numbers
_COUNT = Struct("<HQ")  # a channel and a long number
_STATISTICS_HEAD = Struct("<QHIIIIQQ")  # messages, schemas, channels, two more counts, chunks, times


class McapFile:
    """An MCAP file that is being written; chunks are not compressed.

    Parameters
    ----------
    file : binary file
        An empty one.
    topic : str
    kind : str
        The type of the messages.
    schema : bytes
        Its JSON Schema.
    library : str
        The name of the writing program.
    """

    def __init__(self, file: BinaryIO, topic: str, kind: str, schema: bytes, library: str) -> None:
        self._file, self._place = file, 0
        number = _NUMBER.to_bytes(2, "little")
        self._names = _pack(
            SCHEMA, number, _frame(kind.encode()), _frame(b"jsonschema"), _frame(schema)
        ) + _pack(
            CHANNEL,
            _CHANNEL_HEAD.pack(_NUMBER, _NUMBER),
            _frame(topic.encode()),
            _frame(b"json"),
            _frame(b""),
        )
        self._messages, self._entries = bytearray(), list[tuple[int, int]]()
        self._index, self._times = list[bytes](), list[int]()
        self._count = 0
        self._write(MAGIC, _pack(HEADER, _frame(b""), _frame(library.encode())), self._names)

    def add(self, time: int, data: bytes) -> None:
        """Add a message; `time` is in nanoseconds."""
        self._entries.append((time, len(self._messages)))
        head = _MESSAGE_HEAD.pack(_NUMBER, self._count & 0xFFFFFFFF, time, time)
        self._messages += _pack(MESSAGE, head, data)
        self._count += 1
        if len(self._messages) >= _CHUNK_BYTES:
            self._end_chunk()

    def end(self) -> None:
        """Write the rest: the last chunk and the index."""
        if self._entries:
            self._end_chunk()
        self._write(_pack(DATA_END, bytes(4)))
        start = self._place
        span = (min(self._times), max(self._times)) if self._times else (0, 0)
        statistics = _STATISTICS_HEAD.pack(self._count, 1, 1, 0, 0, len(self._index), *span)
        counts = _frame(_COUNT.pack(_NUMBER, self._count))
        summary = self._names + b"".join(self._index) + _pack(STATISTICS, statistics, counts)
        # no offsets of groups, no checksum
        self._write(summary, _pack(FOOTER, _ENTRY.pack(start, 0), bytes(4)), MAGIC)

    def _end_chunk(self) -> None:
        times = [time for time, _ in self._entries]
        span, data = (min(times), max(times)), bytes(self._messages)
        head = CHUNK_HEAD.pack(*span, len(data), crc32(data))
        chunk = _pack(CHUNK, head, _frame(b""), len(data).to_bytes(8, "little"), data)
        listed = b"".join(_ENTRY.pack(*entry) for entry in self._entries)
        index = _pack(MESSAGE_INDEX, _NUMBER.to_bytes(2, "little"), _frame(listed))
        self._index.append(
            _pack(
                CHUNK_INDEX,
                _CHUNK_PLACE.pack(*span, self._place, len(chunk)),
                _frame(_COUNT.pack(_NUMBER, self._place + len(chunk))),
                len(index).to_bytes(8, "little"),
                _frame(b""),
                _ENTRY.pack(len(data), len(data)),
            )
        )
        self._times += span
        self._write(chunk, index)
        self._messages.clear()
        self._entries.clear()

    def _write(self, *parts: bytes) -> None:
        for part in parts:
            self._file.write(part)
            self._place += len(part)


def _pack(kind: int, *parts: bytes) -> bytes:
    """Return a record."""
    return b"".join((RECORD.pack(kind, sum(map(len, parts))), *parts))


def _frame(data: bytes) -> bytes:
    """Return bytes after their length."""
    return _LENGTH.pack(len(data)) + data
