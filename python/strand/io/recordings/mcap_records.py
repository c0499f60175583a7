"""The records of MCAP files: messages, channels and chunks."""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from struct import error as struct_error
from typing import BinaryIO, NamedTuple
from zlib import crc32

from strand.io.recordings.unpacking import Limits, Work, unpack
from strand.support.files import read_at
from strand.support.mcap_format import CHUNK, CHUNK_HEAD, RECORD

STAMPED = Struct("<BQHIQ")  # a message: kind, size, channel, number, time of recording
BODY = 22  # bytes of a message's record before its data
MAX_NAME = 1024  # bytes of the name of a topic, type or encoding
PLAIN = "messages"  # kind of a chunk that is no record of its own, but some messages in a row
_MAX_HEAD = 256  # bytes of a chunk's record before its data
_COUNTED = 4096  # records that are counted at once
_SIZE = Struct("<Q")
_LENGTH = Struct("<I")


class Channel(NamedTuple):
    """A stream of messages: its topic, its type, and how messages are encoded."""

    topic: str
    kind: str
    encoding: str


class Chunk(NamedTuple):
    """A place with messages.

    Attributes
    ----------
    start, end : int
        Times of the first and the last message, nanoseconds since 1970.
    place : int
        Where its record, or its first message, is in the file.
    size : int
        Decompressed bytes.
    kind : str
        Its compression, or `PLAIN`.
    channels : bytes or None
        Its channels as 16-bit numbers; None if they are not known.
    """

    start: int
    end: int
    place: int
    size: int
    kind: str
    channels: bytes | None


def read_record(file: BinaryIO, at: int, limit: int) -> tuple[int, int, int]:
    """Return the kind of a record, and where its content starts and stops, before `limit`."""
    kind, size = RECORD.unpack(read_at(file, at, RECORD.size))
    start = at + RECORD.size
    if size > limit - start:
        raise ValueError(f"a record at byte {at} declares {size} bytes, but {limit - start} are left")
    return kind, start, start + size


def walk_records(data: memoryview, work: Work) -> Iterator[tuple[int, int, int]]:
    """Yield the kind of each record of a chunk, and where its content starts and stops.

    `work` counts the records.
    """
    at, end, unpack_head, size_head = 0, len(data), RECORD.unpack_from, RECORD.size
    records = 0
    while at < end:
        records += 1
        if records == _COUNTED:
            work.count(records)
            records = 0
        try:
            kind, size = unpack_head(data, at)
        except struct_error:
            raise ValueError("a chunk ends within a record") from None
        start = at + size_head
        at = start + size
        if at > end or kind in (0, CHUNK):
            raise ValueError(
                f"a chunk has a record of kind {kind} and {size} bytes, where {end - start} are left"
            )
        yield kind, start, at
    work.count(records)


def read_text(data: bytes | memoryview, at: int) -> tuple[str, int]:
    """Return a text, and the place after it; raise ValueError if it is long or cut."""
    try:
        (size,) = _LENGTH.unpack_from(data, at)
    except struct_error:
        raise ValueError("a record ends too early") from None
    at += _LENGTH.size
    if size > min(MAX_NAME, len(data) - at):
        raise ValueError(f"a name of {size} bytes, of which {min(MAX_NAME, len(data) - at)} may be read")
    return bytes(data[at : at + size]).decode(), at + size


def read_chunk(file: BinaryIO, chunk: Chunk, limit: int, limits: Limits) -> memoryview:
    """Return the decompressed records of a chunk, whose record ends before `limit`."""
    limits.check_part(chunk.size)
    if chunk.kind == PLAIN:
        file.seek(chunk.place)
        return unpack("", file, chunk.size, chunk.size)
    found, checksum, start, packed = read_chunk_head(file, chunk.place, limit)
    if (found.kind, found.size) != (chunk.kind, chunk.size):
        raise ValueError(f"a chunk has {found.size} bytes of {found.kind!r}, and its index says otherwise")
    file.seek(start)
    data = unpack(chunk.kind, file, packed, chunk.size)
    if checksum and crc32(data) != checksum:
        raise ValueError("a chunk has a wrong checksum")
    return data


def read_chunk_head(file: BinaryIO, place: int, limit: int) -> tuple[Chunk, int, int, int]:
    """Return a chunk by its own record, its checksum, and the place and number of its compressed bytes."""
    kind, start, stop = read_record(file, place, limit)
    head = read_at(file, start, min(stop - start, _MAX_HEAD))
    try:
        begin, end, size, checksum = CHUNK_HEAD.unpack_from(head)
        compression, at = read_text(head, CHUNK_HEAD.size)
        (packed,) = _SIZE.unpack_from(head, at)
    except struct_error:
        raise ValueError("a chunk ends too early") from None
    if kind != CHUNK or packed > stop - start - at - _SIZE.size:
        raise ValueError(f"a chunk declares {packed} compressed bytes, more than it has")
    return Chunk(begin, end, place, size, compression, None), checksum, start + at + _SIZE.size, packed
