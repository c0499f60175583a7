"""What a bag may take while rosbags reads it: bytes of the file, and bytes that it decompresses to."""

from __future__ import annotations

import bz2
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from strand.support.extras import import_extra
from strand.support.files import FileFormatError, open_file

CHUNK_BYTES = 1 << 30  # recorders write chunks of one to a few megabytes
YAML_BYTES = 1 << 18  # of a metadata.yaml
_LINE = 64
_SLACK = 1 << 20


class GuardedPath(type(Path())):  # type: ignore[misc]  # pathlib says only at run time which class it is
    """A path whose file rosbags may read as it is: a regular one, and never more than it holds."""

    def open(self, mode: str = "r", *more: Any, **options: Any) -> Any:
        """Open the file for reading: guarded, unless it is text."""
        if mode != "rb":
            return super().open(mode, *more, **options)
        if self.suffix == ".zstd":
            reason = "compressed as a whole; expected chunks or messages that are, or: decompress it first"
            raise FileFormatError(self, reason)
        return GuardedFile(self)


class GuardedFile:
    """A file that reads no more at once than there is, nor, until it is `indexed`, many times over.

    A damaged or hostile file says any size, and an index may lead to the same place again and again.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, open_file(path)
        self._size = os.fstat(self._file.fileno()).st_size
        self._left: float = 4 * self._size + _SLACK
        self.seek, self.tell, self.close = self._file.seek, self._file.tell, self._file.close

    def indexed(self) -> None:
        """Let the file be read as often as it is gone through."""
        self._left = float("inf")

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes, fewer at the end."""
        data = self._file.read(min(size, self._size))
        self._left -= len(data) + 8  # that nothing is read takes time too
        if self._left < 0:
            raise FileFormatError(self._path, "damaged: its index leads to the same places again and again")
        return data

    def readline(self) -> bytes:
        """Return the first line, or the beginning of it."""
        return self._file.readline(_LINE)


def decompress(decompressor: Callable[[], Any], data: bytes, most: int) -> bytes:
    """Return what compressed bytes hold, if that is no more than so many bytes.

    Raises
    ------
    ValueError
        If it is more.
    """
    out = b""
    while data:
        one = decompressor()
        out += one.decompress(data, max_length=most + 1 - len(out))
        if len(out) > most:
            raise ValueError(f"decompresses to more than the {most} bytes that it may take")
        if not one.eof:
            raise ValueError("truncated compressed data")
        data = one.unused_data or b""
    return out


def decompress_zstd(data: bytes, most: int) -> bytes:
    """Return what bytes that zstd compressed hold, if that is no more than so many bytes."""
    return decompress(import_extra("rosbags.rosbag2.storage_mcap").zstd.ZstdDecompressor, data, most)


def bound_mcap() -> None:
    """Make rosbags decompress a chunk of an MCAP file to no more than the size that it declares."""
    storage = import_extra("rosbags.rosbag2.storage_mcap")

    def sized(decompress: Callable[[bytes, int], bytes]) -> Callable[[bytes, int], bytes]:
        return lambda data, size: decompress(data, min(size, CHUNK_BYTES))

    lz4 = import_extra("lz4.frame").LZ4FrameDecompressor
    storage.DECOMPRESSORS["lz4"] = sized(lambda data, most: decompress(lz4, data, most))
    storage.DECOMPRESSORS["zstd"] = sized(decompress_zstd)


def bound_rosbag1(reader: Any, max_bytes: int) -> None:
    """Make an open reader of a ROS 1 bag decompress each chunk to no more than so many bytes."""
    known = import_extra("rosbags.rosbag1.reader").decompressors
    lz4 = import_extra("lz4.frame").LZ4FrameDecompressor
    bounds = {
        known["bz2"]: lambda data: decompress(bz2.BZ2Decompressor, data, max_bytes),
        known["lz4"]: lambda data: decompress(lz4, data, max_bytes),
    }
    for place, chunk in reader.chunks.items():
        reader.chunks[place] = chunk._replace(decompressor=bounds.get(chunk.decompressor, chunk.decompressor))


def count_open_bytes(chunks: Iterable[Any]) -> int:
    """Bytes of the chunks of an MCAP file that are open at the same time, as their index says."""
    steps = []
    for chunk in chunks:
        steps.append((chunk.message_start_time, 0, chunk.uncompressed_size))
        steps.append((chunk.message_end_time, 1, -chunk.uncompressed_size))
    held = most = 0
    for _, _, size in sorted(steps):
        held += size
        most = max(most, held)
    return most
