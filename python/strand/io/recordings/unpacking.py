"""Decompress parts of recordings, within limits of memory and of work.

A part is refused by the size that it declares, before anything is decompressed; a decompressor stops where
more comes than was declared. A file of few bytes may hold many such parts, so all of them together are
limited by the size of the file.
"""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, BinaryIO

import numpy as np

from strand.io.budget import Budget
from strand.io.recordings.message import Data
from strand.support.extras import import_extra

MAX_PART = 1 << 30  # largest decompressed part, bytes; recorders write a few megabytes
_PIECE = 1 << 18  # compressed bytes that are read at once
_STEP = 1 << 20  # bytes that are decompressed at once
_MAX_FRAMES = 64  # compressed frames, one after the other, that make a part
_MIN_WINDOW = 23  # zstd's window in common files, bits of its number of bytes; it does not exceed the part
_MAX_WINDOW = 30  # bits of the number of bytes of zstd's largest window
# the work that a file may cause
_RATIO = 1024  # decompressed bytes for each byte of the file
_SPARE = 1 << 28  # decompressed bytes beyond these
_RECORD_SHARE = 4  # bytes of the file for each record
_SPARE_RECORDS = 1 << 14  # records beyond these


class Work:
    """The work that is left for one pass over a file of a recording of some files."""

    def __init__(self, file_size: int, files: int = 1) -> None:
        self._bytes = _SPARE // files + _RATIO * file_size
        self._records = _SPARE_RECORDS // files + file_size // _RECORD_SHARE

    def unpack(self, size: int) -> None:
        """Count bytes to decompress; ValueError says that a file of this size may not hold as many."""
        self._bytes -= size
        if self._bytes < 0:
            raise ValueError(
                f"decompresses to more than {_SPARE} bytes and {_RATIO} for each byte of the file"
            )

    def count(self, records: int) -> None:
        """Count messages and other records, as `unpack` counts bytes."""
        self._records -= records
        if self._records < 0:
            raise ValueError(
                f"has more than {_SPARE_RECORDS} records and one for every {_RECORD_SHARE} bytes of the file"
            )


@dataclass(frozen=True)
class Limits:
    """The most that files of a recording may take.

    Attributes
    ----------
    budget : Budget
        The memory for all that stays while a recording is open, such as indexes.
    files : int
        The number of files.
    """

    budget: Budget
    files: int = 1

    @property
    def max_bytes(self) -> int:
        """The most bytes of a decompressed part."""
        return self.budget.max_bytes

    @property
    def max_message(self) -> int:
        """The most bytes of a message: it is in memory beside its part and the message before it."""
        return self.max_bytes // 2

    def begin_pass(self, file_size: int) -> Work:
        """Return the work that a pass over a file may take."""
        return Work(file_size, self.files)

    def check_part(self, size: int) -> None:
        """Raise ValueError if a part declares more bytes than fit."""
        most = min(self.max_bytes, MAX_PART)
        if size > most:
            what = f"max_bytes={most}" if most == self.max_bytes else f"the limit of {MAX_PART}"
            raise ValueError(f"a part of the file takes {size} bytes, more than {what}")

    def check_message(self, size: int) -> None:
        """Raise ValueError if a message has more bytes than fit."""
        if size > self.max_message:
            raise ValueError(f"a message takes {size} bytes, more than half of max_bytes={self.max_bytes}")


def unpack(kind: str, file: BinaryIO, packed: int, size: int) -> memoryview:
    """Return the decompressed bytes of a part, which must be as many as it declares.

    Parameters
    ----------
    kind : str
        "" or "none", "zstd", "lz4" or "bz2".
    file : binary file
        At the first compressed byte.
    packed : int
        The number of compressed bytes.
    size : int
        The decompressed bytes that the part declares; `Limits.check_part` comes before.
    """
    # pages of memory that nothing is written to do not exist yet, so a lying size costs nothing
    whole = memoryview(np.empty(size, dtype=np.uint8).data)
    if kind in ("", "none"):
        if packed != size or file.readinto(whole) != size:  # type: ignore[attr-defined]
            raise ValueError(f"a part of {packed} bytes declares {size}, or the file ends within it")
        return whole.toreadonly()
    at = 0
    for piece in _unpack_pieces(kind, _read_pieces(file, packed), size):
        if len(piece) > size - at:
            raise ValueError(f"decompresses to more than the {size} bytes that it declares")
        whole[at : at + len(piece)] = piece
        at += len(piece)
    if at != size:
        raise ValueError(f"decompresses to {at} bytes, but declares {size}")
    return whole.toreadonly()


def _read_pieces(file: BinaryIO, size: int) -> Iterator[bytes]:
    """Yield the next bytes of a file in pieces; raise ValueError where it ends too early."""
    while size > 0:
        piece = file.read(min(size, _PIECE))
        if not piece:
            raise ValueError(f"the file ends {size} bytes too early")
        size -= len(piece)
        yield piece


def unpack_message(data: Data, most: int) -> bytearray:
    """Return the decompressed bytes of a message in zstd; raise ValueError if they are more than `most`."""
    most = min(most, MAX_PART)
    declared = _import_zstd().get_frame_info(data).decompressed_size or 0
    whole = bytearray()
    if declared <= most:
        for piece in _unpack_pieces("zstd", [data], most):
            whole += piece
            if len(whole) > most:
                break
        else:
            return whole
    raise ValueError(f"a message decompresses to more than {most} bytes, the limit")


def is_zstd(data: Data) -> bool:
    """Tell whether bytes begin as those of zstd do."""
    return bytes(data[:4]) == b"\x28\xb5\x2f\xfd"


def _unpack_pieces(kind: str, pieces: Iterable[Data], size: int) -> Iterator[Data]:
    """Yield decompressed bytes, at most `_STEP` at once."""
    begin = _find_decompressor(kind, size)
    one: Any = None
    frames = 0
    for piece in pieces:
        left = piece
        while left:
            if one is None:
                frames += 1
                if frames > _MAX_FRAMES:
                    raise ValueError(f"expected compressed data of at most {_MAX_FRAMES} frames, got more")
                one = begin()
            yield one.decompress(left, max_length=_STEP)
            while not (one.eof or one.needs_input):
                yield one.decompress(b"", max_length=_STEP)
            left = one.unused_data or b"" if one.eof else b""
            one = None if one.eof else one
    if one is not None:
        raise ValueError("truncated compressed data")


def _find_decompressor(kind: str, size: int) -> Callable[[], Any]:
    """Return the function that makes a decompressor."""
    if kind == "bz2":
        return bz2.BZ2Decompressor
    if kind == "lz4":
        return partial(import_extra("lz4.frame").LZ4FrameDecompressor)
    if kind == "zstd":
        zstd = _import_zstd()
        # its memory is that of the window that a frame declares
        window = min(max(size.bit_length(), _MIN_WINDOW), _MAX_WINDOW)
        return partial(zstd.ZstdDecompressor, options={zstd.DecompressionParameter.window_log_max: window})
    raise ValueError(f"expected a compression of lz4, zstd, bz2 or none, got {kind[:40]!r}")


def _import_zstd() -> Any:
    return import_extra("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
