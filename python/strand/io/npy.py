"""Read NPY files, and single arrays of NPZ archives, of plain numbers and text only."""

from __future__ import annotations

import os
import re
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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


def read_npy(
    path: Path, budget: Budget, shape: tuple[int, ...] | None = None, place: str | None = None
) -> NDArray[Any]:
    """Return the array of an NPY file, of any plain type.

    An array of another shape than `shape`, if given, is not read; that error names `place`.
    """
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        if not size:
            raise FileFormatError(path, "the file is empty")
        declared = _read_header(path, None, file, size, budget.max_bytes)
        if shape not in (None, declared.shape):
            reason = f"expected the depth image's shape {shape}, got {declared.shape}"
            raise FileFormatError(path, reason, place)
        budget.take(path, declared.nbytes)
        return _read_numbers(path, None, file, declared)


@dataclass(frozen=True)
class Declared:
    """An array as the header of an NPY file declares it.

    Attributes
    ----------
    dtype : dtype
    shape : tuple of int
    fortran : bool
        Whether the first index runs fastest.
    left : int
        Bytes that follow the header.
    """

    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    fortran: bool
    left: int

    @property
    def ndim(self) -> int:
        """The number of dimensions."""
        return len(self.shape)

    @property
    def size(self) -> int:
        """The number of elements."""
        return prod(self.shape)

    @property
    def nbytes(self) -> int:
        """The bytes of the elements."""
        return self.size * self.dtype.itemsize


class Archive:
    """An open NPZ archive whose arrays are read one by one; use it in a `with` statement.

    The caller reserves the memory of an array by what `declare` says, before `read`.
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path, self._max_bytes = path, max_bytes
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

    def declare(self, name: str) -> Declared:
        """Return what the header of an array declares."""
        with self._open(name) as (_, declared):
            return declared

    def read(self, name: str) -> NDArray[Any]:
        """Return an array by its name."""
        with self._open(name) as (member, declared):
            array = _read_numbers(self.path, name, member, declared)
            member.read(1)  # the end: zipfile checks the checksum there
            return array

    @contextmanager
    def _open(self, name: str) -> Iterator[tuple[IO[bytes], Declared]]:
        """Open the member of an array after its header."""
        entry = self._members[name + ".npy"]
        if entry.flag_bits & _ENCRYPTED or entry.compress_type not in METHODS:
            raise FileFormatError(
                self.path, "encrypted, or compressed by a method that np.savez_compressed does not use", name
            )
        try:
            with self._zip.open(entry) as member:
                declared = _read_header(self.path, name, member, entry.file_size, self._max_bytes)
                if declared.left != declared.nbytes:
                    reason = f"expected {declared.nbytes} bytes after the .npy header, got {declared.left}"
                    raise FileFormatError(self.path, reason, name)
                yield member, declared
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


def _read_header(path: Path, place: str | None, file: IO[bytes], size: int, max_bytes: int) -> Declared:
    """Read the header of the array at the start of `size` bytes."""

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
    declared = Declared(kind, shape, fortran, size - 8 - len(field) - length)
    if declared.nbytes > declared.left or max(shape, default=0) > max_bytes:
        raise make_error(
            f"truncated: {shape} {kind} takes {declared.nbytes} bytes, but {declared.left} follow the .npy "
            "header"
        )
    return declared


def _read_numbers(path: Path, place: str | None, file: IO[bytes], declared: Declared) -> NDArray[Any]:
    """Read the elements of an array, whose memory is reserved."""
    expected = declared.nbytes
    flat = np.empty(declared.size, dtype=declared.dtype)
    view = memoryview(flat.view(np.uint8).data) if expected else memoryview(b"")
    done = 0
    while done < expected:
        block = file.read(min(_BLOCK, expected - done))
        if not block:
            raise FileFormatError(path, f"truncated: {done} of {expected} bytes", place)
        view[done : done + len(block)] = block
        done += len(block)
    try:
        return flat.reshape(declared.shape, order="F" if declared.fortran else "C")
    except ValueError as error:  # more dimensions than NumPy supports
        raise FileFormatError(path, f"shape: {error}", place) from error


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
