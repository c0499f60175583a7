"""Find where the messages of an MCAP file are: by its index, or in one pass through the file."""

from __future__ import annotations

import os
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from struct import Struct
from struct import error as struct_error
from typing import BinaryIO

import numpy as np

from strand.io.budget import Budget
from strand.io.recordings.mcap_records import (
    BODY,
    MAX_NAME,
    PLAIN,
    STAMPED,
    Channel,
    Chunk,
    read_chunk,
    read_chunk_head,
    read_record,
    read_text,
    walk_records,
)
from strand.io.recordings.unpacking import Limits, Work
from strand.support.files import read_at
from strand.support.mcap_format import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    HEADER,
    MAGIC,
    MESSAGE,
    RECORD,
    SCHEMA,
    STATISTICS,
)

_FOOTER_BYTES = 29  # of the footer's record
_PREFIX = 4 * MAX_NAME  # bytes of the record of a schema or channel that are read
_MAX_RECORD = 1 << 20  # bytes of a record of the index, which may list all channels
_CHANNELS = 1 << 16  # numbers that a channel may have
_TOPIC_BYTES = 2048  # memory of a topic, and of what readers keep of its first message
_SCHEMA_BYTES = 256  # memory of a schema beside its name
_CHUNK_BYTES = 512  # memory of a chunk beside its channels
_OPEN_BYTES = 2048  # memory of a small chunk while it is open
_RUN = 1 << 20  # bytes of messages in a row that are read at once
_NUMBERS = Struct("<HH")  # a channel: its number, and that of its schema
_STATISTICS_HEAD = Struct("<QHIIIIQQI")  # messages, four counts, chunks, times, length of the counts
_INDEX_HEAD = Struct("<QQQQI")  # a chunk: times, place, length, length of its channels
_INDEX_TAIL = Struct("<QQ")  # compressed and decompressed bytes


@dataclass(frozen=True)
class Layout:
    """Where the messages of a file are.

    Attributes
    ----------
    channels : dict of int to Channel
    counts : dict of int to int
        The number of messages of each channel.
    span : (int, int) or None
        Times of the first and the last message, nanoseconds since 1970; None without a message.
    chunks : tuple of Chunk
        In the order of time.
    size : int
        Bytes of the file.
    """

    channels: dict[int, Channel]
    counts: dict[int, int]
    span: tuple[int, int] | None
    chunks: tuple[Chunk, ...]
    size: int


class _Names:
    """The channels and schemas of a file, within a budget."""

    def __init__(self, path: Path, budget: Budget) -> None:
        self._path, self._budget = path, budget
        self._schemas: dict[int, str] = {}
        self.channels: dict[int, Channel] = {}

    def add(self, kind: int, data: bytes | memoryview) -> None:
        """Add a schema or a channel by the beginning of its record; the first of a number counts."""
        if kind == SCHEMA:
            number, name = int.from_bytes(data[:2], "little"), read_text(data, 2)[0]
            if number not in self._schemas:
                self._budget.take(self._path, _SCHEMA_BYTES + 4 * len(name))
                self._schemas[number] = name
        elif kind == CHANNEL:
            number, schema = _NUMBERS.unpack_from(data)
            if number not in self.channels:
                topic, at = read_text(data, _NUMBERS.size)
                self._budget.take(self._path, _TOPIC_BYTES + 4 * len(topic))
                self.channels[number] = Channel(topic, self._schemas.get(schema, ""), read_text(data, at)[0])


class _Run:
    """Messages that follow each other, in a chunk or in the file."""

    def __init__(self, place: int = 0) -> None:
        self.place = self.stop = place
        self.counts: Counter[int] = Counter()
        self._start, self._end = 1 << 64, 0

    def add(self, channel: int, time: int, stop: int) -> None:
        """Add a message that ends at `stop`."""
        self.counts[channel] += 1
        self._start, self._end, self.stop = min(self._start, time), max(self._end, time), stop

    def make_chunk(self, place: int, size: int, kind: str) -> Chunk:
        """Return the chunk of these messages."""
        channels = np.array(sorted(self.counts), dtype=np.uint16).tobytes()
        return Chunk(self._start, self._end, place, size, kind, channels)


def read_layout(file: BinaryIO, path: Path, limits: Limits) -> Layout:
    """Return where the messages of a file are; `limits` are those of its index and chunks."""
    size = os.fstat(file.fileno()).st_size
    try:
        first, last, index = _read_ends(file, size)
        found = _read_index(file, path, limits, first, index, last) if index else None
        return found or _scan(file, path, limits, first, index or last)
    except struct_error:
        raise ValueError("a record ends too early") from None


def _read_ends(file: BinaryIO, size: int) -> tuple[int, int, int]:
    """Return where the first record and the footer are, and where the index is, or 0."""
    last = size - _FOOTER_BYTES - len(MAGIC)
    if last < len(MAGIC) or read_at(file, 0, len(MAGIC)) != MAGIC:
        raise ValueError("no beginning of an MCAP file")
    kind, start, stop = read_record(file, len(MAGIC), last)
    profile, _ = read_text(read_at(file, start, min(stop - start, _PREFIX)), 0)
    if kind != HEADER or profile != "ros2":
        raise ValueError(f"expected an MCAP file of ROS 2, got the profile {profile[:40]!r}")
    footer = read_at(file, last, size - last)
    if footer[-len(MAGIC) :] != MAGIC or RECORD.unpack_from(footer) != (
        FOOTER,
        _FOOTER_BYTES - RECORD.size,
    ):
        raise ValueError("no end of an MCAP file")
    index = int.from_bytes(footer[RECORD.size : RECORD.size + 8], "little")
    if index and not stop <= index <= last:
        raise ValueError("the index is outside of the file")
    return stop, last, index


# Files with an index.


def _read_index(file: BinaryIO, path: Path, limits: Limits, first: int, at: int, last: int) -> Layout | None:
    """Return what the index says; None if it lacks chunks, channels or the numbers of messages."""
    budget, size = limits.budget, os.fstat(file.fileno()).st_size
    names, places, statistics = _Names(path, budget), [], None
    index = at
    while at < last:
        kind, start, stop = read_record(file, at, last)
        if kind in (SCHEMA, CHANNEL):
            names.add(kind, read_at(file, start, min(stop - start, _PREFIX)))
        elif kind in (CHUNK_INDEX, STATISTICS):
            if stop - start > _MAX_RECORD:
                raise ValueError(f"a record of the index of {stop - start} bytes")
            data = read_at(file, start, stop - start)
            if kind == CHUNK_INDEX:
                places.append(_read_place(data))
                budget.take(path, _CHUNK_BYTES + len(places[-1][0].channels or b""))
            else:
                statistics = _read_statistics(data)
        at = stop
    if statistics is None or not names.channels or not 0 < len(places) == statistics[0]:
        return None
    _, counts, span = statistics
    work = limits.begin_pass(size)
    work.count(sum(counts.values()))
    after = first
    for chunk, length in sorted(places, key=lambda one: one[0].place):
        limits.check_part(chunk.size)
        work.unpack(chunk.size)
        if not after <= chunk.place <= index - length:
            raise ValueError("the index leads out of the file, or to one place again and again")
        after = chunk.place + length
    return _order(names, counts, span, [chunk for chunk, _ in places], limits, size)


def _read_place(data: bytes) -> tuple[Chunk, int]:
    """Return a chunk by its record in the index, and the length of its own record."""
    start, end, place, length, listed = _INDEX_HEAD.unpack_from(data)
    at = _INDEX_HEAD.size
    pairs = np.frombuffer(data[at : at + listed], dtype=[("channel", "<u2"), ("place", "<u8")])
    compression, at = read_text(data, at + listed + 8)
    _, size = _INDEX_TAIL.unpack_from(data, at)
    channels = pairs["channel"].astype(np.uint16).tobytes() if listed else None
    return Chunk(start, end, place, size, compression, channels), length


def _read_statistics(data: bytes) -> tuple[int, dict[int, int], tuple[int, int] | None]:
    """Return the number of chunks, that of the messages of each channel, and the span of times."""
    total, *_, chunks, start, end, listed = _STATISTICS_HEAD.unpack_from(data)
    at = _STATISTICS_HEAD.size
    pairs = np.frombuffer(data[at : at + listed], dtype=[("channel", "<u2"), ("count", "<u8")])
    return chunks, dict(pairs.tolist()), (start, max(start, end)) if total else None


# Files without one.


def _scan(file: BinaryIO, path: Path, limits: Limits, at: int, last: int) -> Layout:
    """Return what one pass through the file finds."""
    budget, size = limits.budget, os.fstat(file.fileno()).st_size
    names, work, chunks = _Names(path, budget), limits.begin_pass(size), []
    counts: Counter[int] = Counter()
    row = _Run(at)

    def keep(run: _Run, chunk: Chunk) -> None:
        if run.counts:
            counts.update(run.counts)
            budget.take(path, _CHUNK_BYTES + len(chunk.channels or b""))
            chunks.append(chunk)

    while at < last:
        kind, start, stop = read_record(file, at, last)
        work.count(1)
        if kind == MESSAGE and stop - start >= BODY:
            if stop - row.place > _RUN or at != row.stop:
                keep(row, row.make_chunk(row.place, row.stop - row.place, PLAIN))
                row = _Run(at)
            limits.check_message(stop - at)
            _, _, channel, _, time = STAMPED.unpack(read_at(file, at, STAMPED.size))
            row.add(channel, time, stop)
        elif kind in (SCHEMA, CHANNEL):
            names.add(kind, read_at(file, start, min(stop - start, _PREFIX)))
        elif kind == CHUNK:
            chunk = read_chunk_head(file, at, stop)[0]
            limits.check_part(chunk.size)
            work.unpack(chunk.size)
            run = _scan_chunk(read_chunk(file, chunk, stop, limits), names, work)
            keep(run, run.make_chunk(at, chunk.size, chunk.kind))
        elif kind == DATA_END:
            break
        at = stop
    keep(row, row.make_chunk(row.place, row.stop - row.place, PLAIN))
    span = (min(one.start for one in chunks), max(one.end for one in chunks)) if chunks else None
    return _order(names, counts, span, chunks, limits, size)


def _scan_chunk(data: memoryview, names: _Names, work: Work) -> _Run:
    """Return the messages of a chunk, and add its channels to those that are known."""
    run = _Run()
    for kind, start, stop in walk_records(data, work):
        if kind == MESSAGE and stop - start >= BODY:
            _, _, channel, _, time = STAMPED.unpack_from(data, start - RECORD.size)
            run.add(channel, time, stop)
        elif kind in (SCHEMA, CHANNEL):
            names.add(kind, data[start : min(stop, start + _PREFIX)])
    return run


def _order(
    names: _Names,
    counts: dict[int, int],
    span: tuple[int, int] | None,
    chunks: list[Chunk],
    limits: Limits,
    size: int,
) -> Layout:
    """Return the layout with chunks in the order of time, of which not too many overlap."""
    steps = []
    for chunk in chunks:
        held = max(chunk.size, _OPEN_BYTES)
        steps += [(chunk.start, 0, held), (max(chunk.start, chunk.end), 1, -held)]
    held = 0
    for _, _, change in sorted(steps):
        held += change
        if held > limits.max_bytes:
            raise ValueError(
                f"chunks of {held} bytes overlap in time, more than max_bytes={limits.max_bytes}"
            )
    chunks.sort(key=lambda one: (one.start, one.place))
    return Layout(names.channels, dict(counts), span, tuple(chunks), size)
