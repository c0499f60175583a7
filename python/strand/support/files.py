"""Write files atomically, read them within size limits, and parse JSON and TOML with one error type."""

from __future__ import annotations

import contextlib
import errno
import json
import math
import os
import re
import stat
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from strand._core import StrandError
from strand.support.checks import check_path
from strand.support.extras import import_extra
from strand.support.rights import copy_rights

JSON_BYTES = 7 << 25  # limit of JSON files, bytes; that of one rope's model takes 0.2 MB, one of 68 MB fits
TOML_BYTES = 1 << 18  # largest TOML file, bytes; people write these by hand

_TEXT = 2  # bytes of a byte of JSON, in the text and in a value
# memory of JSON's values by their marks, bytes: a list, an object, an entry, a key, and half of a text
_MARKS = {b"[": 80, b"{": 250, b",": 44, b":": 64, b'"': 32}
_WIDE = 8  # more bytes of it if a letter is beyond ASCII: the letters around it take as many as that one
_HEAD = 64  # bytes of a file that tell whether it may be JSON
_JSON_START = re.compile(rb'(\xef\xbb\xbf)?[ \t\r\n]*(["{[\d-]|true|false|null|NaN|Infinity|\Z)')
_PIECE = 4096  # entries of a list that are written at once
_MAX_REASON = 400  # longest reason in an error, characters: reasons may quote the file
# a key of more than 32 parts: tomllib's time and memory grow with the square of the number of parts
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){32}""")


class FileFormatError(StrandError, ValueError):
    """A file is truncated, has the wrong format, or is larger than the limit.

    Parameters
    ----------
    file : str or path-like
        The file.
    reason : str
        What is wrong, and what is accepted. Reasons of more than 400 characters are cut.
    place : str, optional
        Where the error is in the file: a key, an array of an archive, a line.

    Attributes
    ----------
    file, reason : str
    place : str or None
    """

    def __init__(self, file: str | os.PathLike[str], reason: str, place: str | None = None) -> None:
        self.file = os.fspath(file)
        self.reason = reason if len(reason) <= _MAX_REASON else reason[: _MAX_REASON - 4] + " ..."
        self.place = place
        super().__init__(
            f"{self.file}: {self.reason}" if place is None else f"{self.file}: {place}: {self.reason}"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the arguments of the constructor."""
        return type(self), (self.file, self.reason, self.place)

    @classmethod
    def from_error(cls, file: str | os.PathLike[str], error: Exception) -> FileFormatError:
        """Convert the error of a check; the argument that its message names becomes the place."""
        place, colon, reason = str(error).partition(": ")
        if colon and len(place) < 60:
            return cls(file, reason, place)
        return cls(file, str(error) or type(error).__name__)


def open_file(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a regular file, or a link to one, for reading.

    Devices, pipes and sockets raise FileFormatError: reading them may block for ever or never end.
    """
    path = check_path("path", path)
    # check before opening, which alone may block; check again, as another file may have taken its place
    _require_regular(path, os.stat(path).st_mode)
    file = open(path, "rb", opener=_open_without_waiting)  # noqa: SIM115
    try:
        _require_regular(path, os.fstat(file.fileno()).st_mode)
    except BaseException:
        file.close()
        raise
    return file


def _open_private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _open_without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _require_regular(path: str | os.PathLike[str], mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, "Is a directory", os.fspath(path))
    if not stat.S_ISREG(mode):
        raise FileFormatError(path, "expected a regular file, got a device, a pipe or a socket")


def read_bytes(path: str | os.PathLike[str], max_bytes: int) -> bytes:
    """Return the bytes of a regular file; refuse more than `max_bytes`."""
    with open_file(path) as file:
        size = os.fstat(file.fileno()).st_size
        data = b"" if size > max_bytes else file.read(size + 1)
    if max(size, len(data)) > max_bytes:
        raise FileFormatError(path, f"larger than the {max_bytes} bytes that may be read")
    return data


def read_at(file: BinaryIO, place: int, size: int) -> bytes:
    """Return the bytes at a place of a file; raise ValueError if it ends before."""
    file.seek(place)
    data = file.read(size)
    if len(data) != size:
        raise ValueError(f"the file ends {size - len(data)} bytes too early")
    return data


def require_writable(path: str | os.PathLike[str], links: bool = False) -> Path:
    """Raise OSError if `replace_file` cannot write a file later; return its path with links resolved."""
    target = Path(os.path.realpath(check_path("path", path)))
    if target.is_symlink():  # a link to itself
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EINVAL, "Not a regular file", str(path))
    try:
        os.stat(os.path.join(target.parent, "."))  # fails if the parent is a file
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    if not os.access(target.parent, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    names = target.stat().st_nlink if target.exists() else 1
    if names > 1 and not links:
        reason = f"Has {names} hard links, and replacing the file would break them: remove it first"
        raise OSError(errno.EMLINK, reason, str(path))
    return target


def check_suffix(path: str | os.PathLike[str], accepted: tuple[str, ...]) -> str:
    """Return the suffix of a file's name without the dot, one of the accepted ones."""
    suffix = check_path("path", path).suffix.lower()[1:]
    if suffix not in accepted:
        ends = " or ".join(f".{one}" for one in accepted)
        raise ValueError(f"path: {os.fspath(path)}: expected a name that ends with {ends}")
    return suffix


def write_bytes(path: str | os.PathLike[str], data: bytes, links: bool = False) -> None:
    """Write a file atomically, as `replace_file` does."""
    with replace_file(path, links) as file:
        file.write(data)


@contextlib.contextmanager
def replace_file(path: str | os.PathLike[str], links: bool = False) -> Iterator[BinaryIO]:
    """Open a binary file, for reading too, that replaces an existing one only when it is complete.

    The bytes go to a temporary file in the same folder, which is renamed at the end. If anything fails, the
    existing file stays as it was. The new file gets its mode, and its owner, group and extended attributes
    where the system allows; without an existing file it gets the usual mode. Symbolic links are followed. A
    file with more hard links is refused, as they would keep the old bytes, unless `links` allows that.
    """
    target = require_writable(path, links)
    temporary = target.with_name(f".strand-{os.urandom(8).hex()}.tmp")
    opener = _open_private if target.exists() else None
    try:
        with open(temporary, "x+b", opener=opener) as file:
            yield file
            file.flush()
            copy_rights(target, file.fileno())
            os.fsync(file.fileno())
        os.replace(temporary, target)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise


def convert_to_json(value: Any) -> Any:
    """Return a value in JSON's types: dataclasses become objects, arrays and tuples lists, NaN null."""
    if is_dataclass(value):
        return {entry.name: convert_to_json(getattr(value, entry.name)) for entry in fields(value)}
    if isinstance(value, (np.ndarray, np.generic)):
        listed = value.tolist()
        whole = value.dtype.kind in "biuf" and not np.isnan(value).any()
        return listed if whole else convert_to_json(listed)
    if isinstance(value, dict):
        return {key: convert_to_json(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [convert_to_json(entry) for entry in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def write_json(
    path: str | os.PathLike[str], value: object, links: bool = False, max_bytes: int = JSON_BYTES
) -> None:
    """Write a value to a JSON file atomically, as `convert_to_json` converts it, in little memory.

    Infinity raises ValueError, as JSON has none. A file that `read_json` would refuse raises StrandError.
    """
    marks, wide = 0, False
    with replace_file(path, links) as file:
        try:
            for text in _encode(value):
                data = text.encode()
                file.write(data)
                marks, wide = marks + _weigh_marks(data), wide or _is_wide(data)
                if _sum_memory(file.tell() + 1, marks, wide) > 2 * max_bytes:
                    reason = f"the file would take more memory than 2 x max_bytes={max_bytes}"
                    raise StrandError(f"{os.fspath(path)}: {reason}")
        except ValueError as error:
            raise ValueError(f"{path}: cannot be written as JSON ({error})") from error
        file.write(b"\n")


def _encode(value: Any) -> Iterator[str]:
    """Yield the JSON of a value in pieces; keys are strings."""
    if isinstance(value, dict) and value:
        before = "{"
        for key, entry in value.items():
            yield f"{before}{json.dumps(key)}: "
            yield from _encode(entry)
            before = ", "
        yield "}"
    elif isinstance(value, list) and any(isinstance(entry, dict) for entry in value):
        before = "["
        for entry in value:
            yield before
            yield from _encode(entry)
            before = ", "
        yield "]"
    elif isinstance(value, np.ndarray) and len(value) > _PIECE:
        before = "["
        for start in range(0, len(value), _PIECE):
            yield before + _dump(value[start : start + _PIECE])[1:-1]
            before = ", "
        yield "]"
    else:
        yield _dump(value)


def _dump(value: Any) -> str:
    return json.dumps(convert_to_json(value), allow_nan=False)


def read_json(path: str | os.PathLike[str], max_bytes: int = JSON_BYTES) -> Any:
    """Return the value of a JSON file, in at most 2 x `max_bytes` of memory."""
    _require_json(path, read_head(path))
    return parse_json(path, decode_json(path, read_bytes(path, max_bytes), max_bytes))


def read_head(path: str | os.PathLike[str]) -> bytes:
    """Return the first bytes of a regular file."""
    with open_file(path) as file:
        return file.read(_HEAD)


def _require_json(path: str | os.PathLike[str], head: bytes, place: str | None = None) -> None:
    """Refuse what begins like no JSON, before its size and memory are looked at."""
    if not _JSON_START.match(head):
        raise FileFormatError(path, f"truncated, or not JSON (it begins with {head[:8]!r})", place)


def decode_json(
    path: str | os.PathLike[str], data: bytes, max_bytes: int = JSON_BYTES, place: str | None = None
) -> str:
    """Return JSON in UTF-8 as a text; refuse it if text and values may take more than 2 x `max_bytes`.

    `path` is the file of the text, and `place` its place there. The caller drops the bytes before parsing.
    """
    _require_json(path, data[:_HEAD], place)
    size = _sum_memory(len(data), _weigh_marks(data), _is_wide(data))
    if size > 2 * max_bytes:
        reason = f"text and values may take {size} bytes of memory, more than 2 x max_bytes={max_bytes}"
        raise FileFormatError(path, reason, place)
    try:
        return data.decode("utf-8-sig")
    except ValueError as error:
        raise FileFormatError(path, f"truncated, or not JSON ({error})", place) from error


def parse_json(path: str | os.PathLike[str], text: str, place: str | None = None) -> Any:
    """Return the value of a text of `decode_json`; refuse NaN, Infinity and numbers that overflow (1e999).

    Without a place, errors name the line.
    """
    try:
        return json.loads(text, parse_constant=_refuse_constant, parse_float=_parse_finite)
    except json.JSONDecodeError as error:
        where = place or f"line {error.lineno}"
        raise FileFormatError(path, f"truncated, or not JSON ({error.msg})", where) from error
    except (ValueError, RecursionError) as error:
        raise FileFormatError(path, f"truncated, or not JSON ({error})", place) from error


def _weigh_marks(data: bytes) -> int:
    """Return the memory of JSON's values by their marks, bytes."""
    return sum(each * data.count(mark) for mark, each in _MARKS.items())


def _is_wide(data: bytes) -> bool:
    """Tell whether JSON may have letters beyond ASCII."""
    return not data.isascii() or b"\\u" in data


def _sum_memory(size: int, marks: int, wide: bool) -> int:
    """Return the memory of the text and the values of JSON of `size` bytes, bytes."""
    return (_TEXT + _WIDE * wide) * size + marks


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not JSON")


def _parse_finite(digits: str) -> float:
    value = float(digits)
    if math.isinf(value):
        raise ValueError(f"{digits[:40]} is too large for a 64-bit float")
    return value


def read_toml(path: str | os.PathLike[str], max_bytes: int = TOML_BYTES) -> dict[str, Any]:
    """Read a TOML file of at most `max_bytes`; Python 3.10 needs the package tomli."""
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
