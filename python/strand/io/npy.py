"""NPY files, and arrays of NPZ archives: only those that are asked for, and only plain numbers and text."""

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

HEADER_BYTES = 10_000
DIRECTORY_BYTES = 1 << 20  # some ten thousand members
METHODS = {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}  # np.savez, np.savez_compressed

_ENCRYPTED = 1
_BLOCK = 1 << 20
# one entry of the header, a Python dictionary. NumPy's own reader runs Python's tokenizer and parser on it,
# which have errors of many kinds
_ENTRY = re.compile(
    r"""\s*(['"])(descr|fortran_order|shape)\1\s*:\s*"""
    r"""(?:(?P<type>'[^'\\]{1,40}'|"[^"\\]{1,40}")|(?P<order>True|False)|\((?P<shape>[\d\sL,]{0,600})\))\s*(?:,|(?=\}))"""
)
_TYPE = re.compile(r"[<>|=]?(?:[bifucSUV][1-9]\d{0,17}|\?|[Mm]8(?:\[\w{1,5}\])?)")


def read_npy(path: Path, budget: Budget) -> NDArray[Any]:
    """Array of an NPY file, of any shape and any plain type.

    Raises
    ------
    strand.FileFormatError
        If it is truncated or is something else, holds Python objects, or takes more than the budget.
    """
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        if not size:
            raise FileFormatError(path, "the file is empty")
        return _read_array(path, None, file, size, budget)


class Archive:
    """An NPZ archive whose arrays are read one by one; a context that closes the file.

    Parameters
    ----------
    path : path-like
        The file.
    budget : Budget
        How much its arrays may take.

    Raises
    ------
    strand.FileFormatError
        If it is truncated, or no archive.
    """

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
        """Names of the arrays that it holds."""
        return [name[:-4] for name in self._members if name.endswith(".npy")]

    def read(self, name: str) -> NDArray[Any]:
        """Return an array by its name.

        Raises
        ------
        strand.FileFormatError
            If it is truncated or damaged, not compressed as NumPy does, holds Python objects, or takes more
            than is left of the budget.
        """
        entry = self._members[name + ".npy"]
        if entry.flag_bits & _ENCRYPTED or entry.compress_type not in METHODS:
            raise FileFormatError(
                self.path, "encrypted, or compressed in another way than np.savez_compressed does", name
            )
        try:
            with self._zip.open(entry) as member:
                array = _read_array(self.path, name, member, entry.file_size, self._budget)
                # what follows is read for the sake of the checksum at the end
                left = entry.file_size - member.tell()
                self._budget.take(self.path, left, name)
                while member.read(_BLOCK):
                    pass
                return array
        except FileFormatError:
            raise
        except (*_DAMAGE, OSError) as error:
            raise FileFormatError(self.path, f"truncated or damaged ({error})", name) from error


# what zipfile says of files that are damaged; errors of its own modules too
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
    """A file of which no more is read at once than an archive's directory may take."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self.seek, self.tell, self.seekable = file.seek, file.tell, file.seekable

    def read(self, size: int = -1) -> bytes:
        data = self._file.read(size if 0 <= size <= DIRECTORY_BYTES else DIRECTORY_BYTES + 1)
        if len(data) > DIRECTORY_BYTES:
            raise zipfile.BadZipFile(f"a directory of more than {DIRECTORY_BYTES} bytes")
        return data


def _read_array(path: Path, place: str | None, file: IO[bytes], size: int, budget: Budget) -> NDArray[Any]:
    """Read an array from the start of `size` bytes; what follows it is left."""

    def damaged(reason: str) -> FileFormatError:
        return FileFormatError(path, reason, place)

    start = file.read(8)
    if len(start) < 8 or start[:6] != b"\x93NUMPY" or start[6] not in (1, 2, 3):
        raise damaged("truncated, or not an .npy file")
    field = file.read(2 if start[6] == 1 else 4)
    length = int.from_bytes(field, "little")
    if length > HEADER_BYTES:
        raise damaged(f"expected an .npy header of up to {HEADER_BYTES} bytes, got {length}")
    header = file.read(length)
    if len(field) < 2 or len(header) < max(length, 1):
        raise damaged("truncated in the .npy header")
    kind, fortran, shape = _parse_header(header, damaged)
    count = prod(shape)
    expected = count * kind.itemsize
    held = size - 8 - len(field) - length
    if expected > held or max(shape, default=0) > budget.max_bytes:
        raise damaged(f"truncated: {shape} {kind} takes {expected} bytes, and {held} follow the .npy header")
    budget.take(path, expected, place)
    flat = np.empty(count, dtype=kind)
    view = memoryview(flat.view(np.uint8).data) if expected else memoryview(b"")
    done = 0
    while done < expected:
        block = file.read(min(_BLOCK, expected - done))
        if not block:
            raise damaged(f"truncated: {done} of {expected} bytes")
        view[done : done + len(block)] = block
        done += len(block)
    try:
        return flat.reshape(shape, order="F" if fortran else "C")
    except ValueError as error:  # more dimensions than NumPy has
        raise damaged(f"shape: {error}") from error


def _parse_header(header: bytes, damaged: Any) -> tuple[np.dtype[Any], bool, tuple[int, ...]]:
    """Type, order and shape of what follows an NPY header."""
    text = header.decode("latin-1").strip()
    found, at = {}, 1
    while match := _ENTRY.match(text, at):
        found[match[2]], at = match, match.end()
    whole = text[:1] == "{" and text[at:].strip() == "}" and len(found) == 3
    if not whole or not (found["descr"]["type"] and found["fortran_order"]["order"]):
        raise damaged("not an .npy header of an array of plain numbers or text")
    shape = found["shape"]["shape"]
    if shape is None or not re.fullmatch(r"\s*(?:\d{1,18}L?\s*(?:,\s*|$))*", shape):
        raise damaged("not an .npy header: expected a shape of whole numbers")
    described = found["descr"]["type"][1:-1]
    if "O" in described:
        raise damaged("holds Python objects (pickles), which are not read")
    try:
        kind = np.dtype(described) if _TYPE.fullmatch(described) else None
    except (TypeError, ValueError):
        kind = None
    if kind is None:
        raise damaged(f"expected a plain type such as '<f4', got {described!r}")
    return kind, found["fortran_order"]["order"] == "True", tuple(int(n) for n in re.findall(r"\d+", shape))
