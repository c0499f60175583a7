"""Read rows of numbers from the text of a point cloud file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from strand.support.files import FileFormatError

_BLOCK = 1 << 16  # bytes split at once, and the longest line


def split_lines(path: Path, body: memoryview) -> Iterator[bytes]:
    """Yield the lines that are not blank, splitting one block at a time."""
    at, rest = 0, b""
    while at < len(body):
        *whole, rest = (rest + bytes(body[at : at + _BLOCK])).split(b"\n")
        at += _BLOCK
        if len(rest) > _BLOCK:
            raise FileFormatError(path, f"a line of more than {_BLOCK} bytes")
        yield from (line for line in whole if not line.isspace() and line)
    if rest.strip():
        yield rest


def is_long_enough(body: memoryview, numbers: int) -> bool:
    """Tell whether the text can hold this many numbers: each takes a digit, and a space or a line break."""
    return 2 * numbers <= len(body) + 1


def read_rows(
    path: Path,
    each: Iterator[bytes],
    table: NDArray[Any],
    columns: Sequence[int],
    width: int,
    row: str,
    separator: bytes | None = None,
) -> bool:
    """Fill an (N, K) table from the next N lines; return False if there are fewer lines.

    Each line must have `width` words; `columns` are the K words to read. Messages call a line `row`, such as
    "vertex". Words are separated by white space unless `separator` is given.
    """
    for i in range(len(table)):
        words = next(each, b"").split(separator)
        if len(words) < width and next(each, None) is None:
            return False
        if len(words) != width:
            raise FileFormatError(path, f"expected {width} numbers, got {len(words)}", f"{row} {i}")
        try:
            table[i] = [float(words[column]) for column in columns]
        except ValueError:
            shown = b" ".join(words)[:80].decode("latin-1")
            raise FileFormatError(path, f"expected numbers, got {shown!r}", f"{row} {i}") from None
    return True
