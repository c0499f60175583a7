"""Bound the bytes that rosbags reads from a bag, and the bytes that it decompresses."""

from __future__ import annotations

import bz2
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from strand.support.extras import import_extra
from strand.support.files import FileFormatError, open_file

CHUNK_BYTES = 1 << 30  # largest decompressed chunk, bytes; recorders write a few megabytes
YAML_BYTES = 1 << 18  # largest metadata.yaml, bytes
_MAX_LINE = 64  # longest first line, bytes
_SLACK = 1 << 20  # bytes that may be read beyond four times the file's size
_READ_COST = 8  # bytes that each read counts as, as empty reads take time too


class GuardedPath(type(Path())):  # type: ignore[misc]  # pathlib chooses the class at run time
    """A path that opens its file as a `GuardedFile`, and only if it is a regular file."""

    def open(self, mode: str = "r", *more: Any, **options: Any) -> Any:
        """Open the file for reading; text files are not guarded."""
        if mode != "rb":
            return super().open(mode, *more, **options)
        if self.suffix == ".zstd":
            reason = "the file is compressed as a whole; decompress it first (compressed chunks are fine)"
            raise FileFormatError(self, reason)
        return GuardedFile(self)


class GuardedFile:
    """A file that never allocates more than its size, nor reads forever while rosbags reads its index.

    A damaged or hostile file may declare any size, and its index may lead to the same place again and again.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, open_file(path)
        self._size = os.fstat(self._file.fileno()).st_size
        self._left: float = 4 * self._size + _SLACK
        self.seek, self.tell, self.close = self._file.seek, self._file.tell, self._file.close

    def lift_limit(self) -> None:
        """Allow any number of reads, once the index was read."""
        self._left = float("inf")

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes, or fewer at the end of the file."""
        data = self._file.read(min(size, self._size))
        self._left -= len(data) + _READ_COST
        if self._left < 0:
            raise FileFormatError(self._path, "damaged: the index leads to the same places again and again")
        return data

    def readline(self) -> bytes:
        """Return the first line, or its beginning."""
        return self._file.readline(_MAX_LINE)


def decompress(decompressor: Callable[[], Any], data: bytes, most: int) -> bytes:
    """Return the decompressed bytes; raise ValueError if they are more than `most`."""
    out = b""
    while data:
        one = decompressor()
        out += one.decompress(data, max_length=most + 1 - len(out))
        if len(out) > most:
            raise ValueError(f"decompresses to more than {most} bytes, the limit")
        if not one.eof:
            raise ValueError("truncated compressed data")
        data = one.unused_data or b""
    return out


def decompress_zstd(data: bytes, most: int) -> bytes:
    """Return the decompressed bytes of zstd data; raise ValueError if they are more than `most`."""
    return decompress(import_extra("rosbags.rosbag2.storage_mcap").zstd.ZstdDecompressor, data, most)


def bound_mcap() -> None:
    """Make rosbags bound each chunk of an MCAP file by the size that the chunk declares."""
    storage = import_extra("rosbags.rosbag2.storage_mcap")

    def limit(method: Callable[[bytes, int], bytes]) -> Callable[[bytes, int], bytes]:
        return lambda data, size: method(data, min(size, CHUNK_BYTES))

    lz4 = import_extra("lz4.frame").LZ4FrameDecompressor
    storage.DECOMPRESSORS["lz4"] = limit(lambda data, most: decompress(lz4, data, most))
    storage.DECOMPRESSORS["zstd"] = limit(decompress_zstd)


def bound_rosbag1(reader: Any, max_bytes: int) -> None:
    """Make an open reader of a ROS 1 bag bound each decompressed chunk by `max_bytes`."""
    known = import_extra("rosbags.rosbag1.reader").decompressors
    lz4 = import_extra("lz4.frame").LZ4FrameDecompressor
    bounds = {
        known["bz2"]: lambda data: decompress(bz2.BZ2Decompressor, data, max_bytes),
        known["lz4"]: lambda data: decompress(lz4, data, max_bytes),
    }
    for place, chunk in reader.chunks.items():
        reader.chunks[place] = chunk._replace(decompressor=bounds.get(chunk.decompressor, chunk.decompressor))


def count_open_bytes(chunks: Iterable[Any]) -> int:
    """Return the most decompressed bytes of MCAP chunks that overlap in time, by their index."""
    steps = []
    for chunk in chunks:
        steps.append((chunk.message_start_time, 0, chunk.uncompressed_size))
        steps.append((chunk.message_end_time, 1, -chunk.uncompressed_size))
    held = most = 0
    for _, _, size in sorted(steps):
        held += size
        most = max(most, held)
    return most
