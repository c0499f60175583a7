"""Read the index of a ROS 1 bag: its connections, its chunks, and where its messages are."""

from __future__ import annotations

import os
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from strand.io.recordings.ros1_records import (
    BAG,
    CHUNK,
    CHUNK_INFO,
    CONNECTION,
    INDEX,
    Fields,
    normalize_kind,
    normalize_topic,
    read_record,
)
from strand.io.recordings.unpacking import Limits
from strand.support.files import read_at

_MAGIC = b"#ROSBAG V2.0\n"  # how a bag begins
_VERSION = 1  # of the index
_MAX_DEFINITION = 1 << 20  # bytes of a connection's own fields, of which one defines its type
_TOPIC_BYTES = 2048  # memory of a connection, and of what readers keep of its first message
_CHUNK_BYTES = 512  # memory of a chunk's place
_LIST_BYTES = 64  # memory of the entries of one connection in one chunk, beside these
_ENTRY_BYTES = 64  # memory of a message's entry while all are sorted
_ENTRY = np.dtype([("sec", "<u4"), ("nanosec", "<u4"), ("place", "<u4")])
_COUNT_BYTES = 8  # of a connection's number, and that of its messages, in the list of a chunk


class Connection(NamedTuple):
    """A stream of messages: its topic and its type."""

    topic: str
    kind: str


class Chunk(NamedTuple):
    """Where a chunk's bytes are in the file, their number, compression, and number when decompressed."""

    place: int
    packed: int
    kind: str
    size: int


@dataclass(frozen=True, eq=False)
class Index:
    """The messages of a bag in the order of time.

    Attributes
    ----------
    connections : dict of int to Connection
    chunks : tuple of Chunk
    times : (N,) ndarray
        Time of each message, nanoseconds since 1970.
    keys : (N,) ndarray
        Its connection.
    numbers : (N,) ndarray
        The number of its chunk.
    places : (N,) ndarray
        Its place in the decompressed chunk.
    size : int
        Bytes of the file.
    """

    connections: dict[int, Connection]
    chunks: tuple[Chunk, ...]
    times: NDArray[np.int64]
    keys: NDArray[np.uint32]
    numbers: NDArray[np.uint32]
    places: NDArray[np.uint32]
    size: int


def read_index(file: BinaryIO, path: Path, limits: Limits) -> Index:
    """Return the index of a bag; `limits` are those of its index and chunks."""
    size, budget = os.fstat(file.fileno()).st_size, limits.budget
    if read_at(file, 0, len(_MAGIC)) != _MAGIC:
        raise ValueError("no ROS bag of version 2.0")
    bag = read_record(file, len(_MAGIC), BAG).fields
    if bag.get_name("encryptor", ""):
        raise ValueError("the bag is encrypted")
    at = bag.get_number("index_pos", 8)
    if not at:
        raise ValueError("the bag is not indexed; rosbag reindex does that")
    connections: dict[int, Connection] = {}
    for _ in range(bag.get_number("conn_count", 4)):
        record = read_record(file, at, CONNECTION)
        budget.take(path, _TOPIC_BYTES)
        connections[record.fields.get_number("conn", 4)] = _read_connection(
            file, record.fields, record.start, record.stop
        )
        at = record.stop
    places = []
    for _ in range(bag.get_number("chunk_count", 4)):
        record = read_record(file, at, CHUNK_INFO)
        if record.fields.get_number("ver", 4) != _VERSION:
            raise ValueError("an index of another version")
        budget.take(path, _CHUNK_BYTES)
        count = record.fields.get_number("count", 4)
        if count * _COUNT_BYTES > size - record.start:
            raise ValueError(f"a chunk declares {count} connections, more than the file has")
        places.append((record.fields.get_number("chunk_pos", 8), count))
        at = record.start + count * _COUNT_BYTES
    return _read_entries(file, path, size, limits, connections, places)


def _read_connection(file: BinaryIO, fields: Fields, start: int, stop: int) -> Connection:
    if stop - start > _MAX_DEFINITION:
        raise ValueError(f"a connection with {stop - start} bytes of fields")
    own = Fields(read_at(file, start, stop - start))
    return Connection(normalize_topic(fields.get_name("topic")), normalize_kind(own.get_name("type")))


def _read_entries(
    file: BinaryIO,
    path: Path,
    size: int,
    limits: Limits,
    connections: dict[int, Connection],
    places: list[tuple[int, int]],
) -> Index:
    """Read the entries that follow each chunk, and sort them by time."""
    chunks: list[Chunk] = []
    raw, work = bytearray(), limits.begin_pass(size)
    keys, numbers, counts = array("I"), array("I"), array("I")  # of each list of entries
    after = 0
    for place, lists in sorted(places):
        if place < after:
            raise ValueError("the index leads to the same place again and again")
        record = read_record(file, place, CHUNK)
        chunk = Chunk(
            record.start,
            record.stop - record.start,
            record.fields.get_name("compression"),
            record.fields.get_number("size", 4),
        )
        limits.check_part(chunk.size)
        work.unpack(chunk.size)
        after = record.stop
        for _ in range(lists):
            found = read_record(file, after, INDEX)
            count, length = found.fields.get_number("count", 4), found.stop - found.start
            key = found.fields.get_number("conn", 4)
            if found.fields.get_number("ver", 4) != _VERSION or length != count * _ENTRY.itemsize:
                raise ValueError(f"damaged entries of the index: {count} in {length} bytes")
            if key not in connections:
                raise ValueError(f"the index has no connection {key}")
            work.count(count)
            limits.budget.take(path, _LIST_BYTES + _ENTRY_BYTES * count)
            raw += read_at(file, found.start, length)
            keys.append(key)
            numbers.append(len(chunks))
            counts.append(count)
            after = found.stop
        chunks.append(chunk)
    entries = np.frombuffer(raw, dtype=_ENTRY)
    times = entries["sec"] * np.int64(10**9) + entries["nanosec"]
    numbers_of = _repeat(numbers, counts)
    if len(np.unique(numbers_of.astype(np.uint64) << np.uint64(32) | entries["place"])) < len(entries):
        raise ValueError("the index leads to the same message again and again")
    order = np.argsort(times, kind="stable")
    return Index(
        connections,
        tuple(chunks),
        times[order],
        _repeat(keys, counts)[order],
        numbers_of[order],
        entries["place"][order],
        size,
    )


def _repeat(values: array[int], counts: array[int]) -> NDArray[Any]:
    """Return each value as often as it counts."""
    return np.repeat(np.frombuffer(values, dtype=np.uint32), np.frombuffer(counts, dtype=np.uint32))
