"""Rows of numbers in text, as point cloud files hold them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from strand.support.files import FileFormatError

_BLOCK = 1 << 16  # bytes taken apart at once


def split_lines(path: Path, body: memoryview) -> Iterator[bytes]:
    """Lines that are not blank, taken apart a block at a time.

    Raises
    ------
    strand.FileFormatError
        If one is longer than a block.
    """
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
    """Whether text is long enough for so many numbers: each takes a digit, and a space or a line's end."""
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
    """Fill a table with some columns of as many lines as it has rows.

    Parameters
    ----------
    path : Path
        The file, for messages.
    each : iterator of bytes
        The lines.
    table : (N, K) ndarray of float
        What is filled.
    columns : sequence of K ints
        Which words of a line.
    width : int
        How many words a line has.
    row : str
        What a message calls a line: "vertex", "point".
    separator : bytes, optional
        What stands between words; white space if not given.

    Returns
    -------
    bool
        Whether there were enough lines.

    Raises
    ------
    strand.FileFormatError
        If a line has another number of words, or words that are no numbers.
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
