"""Files written whole or not at all, and read within limits; JSON and TOML with one kind of error."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import reprlib
import secrets
import stat
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from strand._core import StrandError
from strand.support.extras import import_extra

JSON_BYTES = 1 << 26  # a model of a rope takes 0.2 MB
TOML_BYTES = 1 << 20  # descriptions and configurations are written by hand

_REASON = 400  # characters; what a file says may be in it, at any length
# tomllib takes time and memory with the square of a key's parts
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){32}""")


class FileFormatError(StrandError, ValueError):
    """A file is truncated, not what it should be, or larger than what may be read of it.

    Parameters
    ----------
    file : str or path-like
        The file.
    reason : str
        What is wrong, and what is accepted.
    place : str, optional
        Where in the file: a key, an array of an archive, a line.

    Attributes
    ----------
    file, reason, place : str
        The same as text; `place` may be None.
    """

    def __init__(self, file: str | os.PathLike[str], reason: str, place: str | None = None) -> None:
        self.file = os.fspath(file)
        self.reason = reason if len(reason) <= _REASON else reason[: _REASON - 4] + " ..."
        self.place = place
        super().__init__(
            f"{self.file}: {self.reason}" if place is None else f"{self.file}: {place}: {self.reason}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle what it was made of."""
        return type(self), (self.file, self.reason, self.place)

    @classmethod
    def from_error(cls, file: str | os.PathLike[str], error: Exception) -> FileFormatError:
        """Make one of a check's error, whose message names the argument first: here the place."""
        place, colon, reason = str(error).partition(": ")
        if colon and len(place) < 60:
            return cls(file, reason, place)
        return cls(file, str(error) or type(error).__name__)


def describe_value(value: Any) -> str:
    """Return what a message says of a value, however long or deep it is."""
    try:
        return reprlib.repr(value)
    except ValueError:  # a whole number of thousands of digits
        return f"a long {type(value).__name__}"


def open_file(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file for reading.

    Parameters
    ----------
    path : str or path-like
        The file, or a link to it.

    Raises
    ------
    strand.FileFormatError
        If it is a device, a pipe or a socket: these may have no end, or never begin.
    OSError
        If it is missing, a folder, or cannot be read.
    """
    # before it is opened, as that alone may wait for ever; and after, as another may have taken its place
    _require_regular(path, os.stat(path).st_mode)
    file = open(path, "rb", opener=_open_without_waiting)  # noqa: SIM115
    try:
        _require_regular(path, os.fstat(file.fileno()).st_mode)
    except BaseException:
        file.close()
        raise
    return file


def _open_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _require_regular(path: str | os.PathLike[str], mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "Is a directory", os.fspath(path))
    if not stat.S_ISREG(mode):
        raise FileFormatError(path, "expected a regular file, got a device, a pipe or a socket")


def read_bytes(path: str | os.PathLike[str], max_bytes: int) -> bytes:
    """Return what a regular file holds, if that is no more than so many bytes.

    Parameters
    ----------
    path : str or path-like
        The file.
    max_bytes : int
        How many there may be.

    Raises
    ------
    strand.FileFormatError
        If it is larger, or no regular file.
    OSError
        If it is missing, or cannot be read.
    """
    with open_file(path) as file:
        data = file.read(min(os.fstat(file.fileno()).st_size, max_bytes) + 1)
    if len(data) > max_bytes:
        raise FileFormatError(path, f"larger than the {max_bytes} bytes that may be read")
    return data


def require_writable(path: str | os.PathLike[str]) -> Path:
    """Refuse a file that cannot be written, before there is anything to write.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    Path
        Where it is, links followed.

    Raises
    ------
    OSError
        If its folder does not exist or cannot be written, or `path` is something other than a file.
    """
    target = Path(os.path.realpath(path))
    if target.is_symlink():  # a link to itself
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    try:
        os.stat(os.path.join(target.parent, "."))  # a file has none
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    return target


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file whole or not at all, see `replacing`.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced, through links.
    data : bytes
        Its content.

    Raises
    ------
    OSError
        If the file cannot be written, or `path` is something other than a file.
    """
    with replace_file(path) as file:
        file.write(data)


@contextlib.contextmanager
def replace_file(path: str | os.PathLike[str]) -> Iterator[BinaryIO]:
    """Open a file that is written whole or not at all.

    The bytes go to a temporary file in the same folder, which takes the file's place at the end: nobody
    sees half a file, and one that exists stays as it was if anything fails.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced, through links.

    Yields
    ------
    file
        To write bytes to.

    Raises
    ------
    OSError
        If the file cannot be written, or `path` is something other than a file.
    """
    target = require_writable(path)
    temporary = target.with_name(f".strand-{secrets.token_hex(8)}.tmp")
    try:
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def convert_to_json(value: Any) -> Any:
    """Return a value in JSON's types.

    Parameters
    ----------
    value : object
        Frozen dataclasses become objects with a key for each field, arrays and tuples lists, NaN null.
    """
    if is_dataclass(value):
        return {entry.name: convert_to_json(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, (np.ndarray, np.generic)):
        return convert_to_json(value.tolist())
    if isinstance(value, dict):
        return {key: convert_to_json(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [convert_to_json(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def write_json(path: str | os.PathLike[str], value: object) -> None:
    """Write a JSON file whole or not at all.

    Parameters
    ----------
    path : str or path-like
        The file; one that exists is replaced.
    value : object
        Dictionaries, lists, text, numbers, booleans and None.

    Raises
    ------
    TypeError
        If something in `value` has no form in JSON.
    ValueError
        If a number is NaN or infinite, which JSON cannot say.
    OSError
        If the file cannot be written.
    """
    try:
        text = json.dumps(value, allow_nan=False)
    except ValueError as error:
        raise ValueError(f"{path}: cannot be written as JSON ({error})") from error
    write_bytes(path, text.encode() + b"\n")


def read_json(path: str | os.PathLike[str], max_bytes: int = JSON_BYTES) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    path : str or path-like
        The file.
    max_bytes : int
        How large it may be. What it says takes up to 25 times as much memory.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is truncated, not JSON or larger, or says NaN, Infinity or 1e999.
    """
    return parse_json(path, read_bytes(path, max_bytes))


def parse_json(path: str | os.PathLike[str], data: bytes, place: str | None = None) -> Any:
    """Return what JSON says.

    Parameters
    ----------
    path : str or path-like
        The file that it is from.
    data : bytes
        All of it, or a part.
    place : str, optional
        Where the part is; if not given, errors say which line.

    Raises
    ------
    strand.FileFormatError
        If it is truncated, not JSON, or says NaN, Infinity or 1e999.
    """
    try:
        return json.loads(data, parse_constant=_refuse_constant, parse_float=_finite)
    except json.JSONDecodeError as error:
        where = place or f"line {error.lineno}"
        raise FileFormatError(path, f"truncated, or not JSON ({error.msg})", where) from error
    except (ValueError, RecursionError) as error:
        raise FileFormatError(path, f"truncated, or not JSON ({error})", place) from error


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def _finite(digits: str) -> float:
    value = float(digits)
    if math.isinf(value):
        raise ValueError(f"{digits[:40]} is more than a number holds")
    return value


def read_toml(path: str | os.PathLike[str], max_bytes: int = TOML_BYTES) -> dict[str, Any]:
    """Read a TOML file.

    Parameters
    ----------
    path : str or path-like
        The file.
    max_bytes : int
        How large it may be.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    strand.FileFormatError
        If it is truncated, not TOML or larger, or has keys of more than 32 parts.
    ImportError
        On Python 3.10, which has no TOML reader, if the package tomli is not installed.
    """
    toml = import_extra("tomllib" if sys.version_info >= (3, 11) else "tomli")
    data = read_bytes(path, max_bytes)
    try:
        words = data.decode()
        if _LONG_KEY.search(words):
            raise ValueError("a key of more than 32 parts")
        content: dict[str, Any] = toml.loads(words)
    except (ValueError, RecursionError) as error:
        raise FileFormatError(path, f"truncated, or not TOML ({error})") from error
    return content
