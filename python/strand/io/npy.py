"""Read NPY files, and single arrays of NPZ archives, of plain numbers and text only."""

from __future__ import annotations

import os
import re
import zipfile
import zlib
from math import prod
from pathlib import Path
from typing import IO, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.support.files import FileFormatError, open_file

MAX_HEADER = 10_000  # longest header of an NPY file, bytes
MAX_DIRECTORY = 1 << 20  # largest directory of an archive, bytes: about ten thousand members
METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}  # as written by np.savez and np.savez_compressed

_ENCRYPTED = 1  # the flag bit of an encrypted member
_BLOCK = 1 << 20  # bytes read at once
# one entry of the header, which is a Python dictionary; NumPy's reader runs Python's tokenizer and parser
# on it, which raise errors of many types
_ENTRY = re.compile(
    r"""\s*(['"])(descr|fortran_order|shape)\1\s*:\s*"""
    r"""(?:(?P<type>'[^'\\]{1,40}'|"[^"\\]{1,40}")|(?P<order>True|False)|\((?P<shape>[\d\sL,]{0,600})\))\s*(?:,|(?=\}))"""
)
_TYPE = re.compile(r"[<>|=]?(?:[bifucSUV][1-9]\d{0,17}|\?|[Mm]8(?:\[\w{1,5}\])?)")


def read_npy(path: Path, budget: Budget) -> NDArray[Any]:
    """Return the array of an NPY file, of any shape and any plain type."""
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        if not size:
            raise FileFormatError(path, "the file is empty")
        return _read_array(path, None, file, size, budget)


class Archive:
    """An open NPZ archive whose arrays are read one by one; use it in a `with` statement."""

    def __init__(self, path: Path, budget: Budget) -> None:
        self.path, self._budget = path, budget
        self._file = open_file(path)
        try:
            self._zip = zipfile.ZipFile(_ShortReads(self._file))
        except BaseException as error:
            empty = not os.fstat(self._file.fileno()).st_size
            self._file.close()
            if empty:
                raise FileFormatError(path, "the file is empty") from None
            if not isinstance(error, (*_DAMAGE, OSError)):
                raise
            raise FileFormatError(path, f"truncated, or not an .npz file ({error})") from error
        self._members = {entry.filename: entry for entry in self._zip.infolist()}

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()
        self._file.close()

    @property
    def names(self) -> list[str]:
        """Names of the arrays in the archive."""
        return [name[:-4] for name in self._members if name.endswith(".npy")]

    def read(self, name: str) -> NDArray[Any]:
        """Return an array by its name."""
        entry = self._members[name + ".npy"]
        if entry.flag_bits & _ENCRYPTED or entry.compress_type not in METHODS:
            raise FileFormatError(
                self.path, "encrypted, or compressed by a method that np.savez_compressed does not use", name
            )
        try:
            with self._zip.open(entry) as member:
                array = _read_array(self.path, name, member, entry.file_size, self._budget)
                # zipfile checks the checksum only at the end of the member, so read the rest
                left = entry.file_size - member.tell()
                self._budget.take(self.path, left, name)
                while member.read(_BLOCK):
                    pass
                return array
        except FileFormatError:
            raise
        except (*_DAMAGE, OSError) as error:
            raise FileFormatError(self.path, f"truncated or damaged ({error})", name) from error


# errors of zipfile, and of the modules that it uses, for damaged files
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    NotImplementedError,
    EOFError,
    IndexError,
    OverflowError,
    UnicodeError,
    ValueError,
)


class _ShortReads:
    """A file that reads at most `MAX_DIRECTORY` bytes at once, as zipfile reads the directory whole."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size if 0 <= size <= MAX_DIRECTORY else MAX_DIRECTORY + 1)
        if len(data) > MAX_DIRECTORY:
            raise zipfile.BadZipFile(f"a directory of more than {MAX_DIRECTORY} bytes")
        return data


def _read_array(path: Path, place: str | None, file: IO[bytes], size: int, budget: Budget) -> NDArray[Any]:
    """Read the array at the start of `size` bytes; leave the rest unread."""

    def make_error(reason: str) -> FileFormatError:
        return FileFormatError(path, reason, place)

    start = file.read(8)
    if len(start) < 8 or start[:6] != b"\x93NUMPY" or start[6] not in (1, 2, 3):
        raise make_error("truncated, or not an .npy file")
    field = file.read(2 if start[6] == 1 else 4)
    length = int.from_bytes(field, "little")
    if length > MAX_HEADER:
        raise make_error(f"expected an .npy header of up to {MAX_HEADER} bytes, got {length}")
    header = file.read(length)
    if len(field) < 2 or len(header) < max(length, 1):
        raise make_error("truncated in the .npy header")
    kind, fortran, shape = _parse_header(header, make_error)
    count = prod(shape)
    expected = count * kind.itemsize
    held = size - 8 - len(field) - length
    if expected > held or max(shape, default=0) > budget.max_bytes:
        raise make_error(
            f"truncated: {shape} {kind} takes {expected} bytes, but {held} follow the .npy header"
        )
    budget.take(path, expected, place)
    flat = np.empty(count, dtype=kind)
    view = memoryview(flat.view(np.uint8).data) if expected else memoryview(b"")
    done = 0
    while done < expected:
        block = file.read(min(_BLOCK, expected - done))
        if not block:
            raise make_error(f"truncated: {done} of {expected} bytes")
        view[done : done + len(block)] = block
        done += len(block)
    try:
        return flat.reshape(shape, order="F" if fortran else "C")
    except ValueError as error:  # more dimensions than NumPy supports
        raise make_error(f"shape: {error}") from error


def _parse_header(header: bytes, make_error: Any) -> tuple[np.dtype[Any], bool, tuple[int, ...]]:
    """Return the type, whether the order is Fortran's, and the shape, from an NPY header."""
    text = header.decode("latin-1").strip()
    found, at = {}, 1
    while match := _ENTRY.match(text, at):
        found[match[2]], at = match, match.end()
    whole = text[:1] == "{" and text[at:].strip() == "}" and len(found) == 3
    if not whole or not (found["descr"]["type"] and found["fortran_order"]["order"]):
        raise make_error("not an .npy header of an array of plain numbers or text")
    shape = found["shape"]["shape"]
    if shape is None or not re.fullmatch(r"\s*(?:\d{1,18}L?\s*(?:,\s*|$))*", shape):
        raise make_error("not an .npy header: expected a shape of whole numbers")
    described = found["descr"]["type"][1:-1]
    if "O" in described:
        raise make_error("holds Python objects (pickles), which strand does not read")
    try:
        kind = np.dtype(described) if _TYPE.fullmatch(described) else None
    except (TypeError, ValueError):
        kind = None
    if kind is None:
        raise make_error(f"expected a plain type such as '<f4', got {described!r}")
    return kind, found["fortran_order"]["order"] == "True", tuple(int(n) for n in re.findall(r"\d+", shape))
