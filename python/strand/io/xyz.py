"""Read points and colours from text, XYZ or CSV, with or without a header line."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strand.io.budget import Budget
from strand.io.point_cloud import PointCloud, scale_colors
from strand.io.text_rows import read_rows, split_lines
from strand.support.files import FileFormatError

COLORS = (("red", "green", "blue"), ("r", "g", "b"))
COMMENTS = (b"#", b"//")


@dataclass(frozen=True)
class Columns:
    """The columns of a text.

    Attributes
    ----------
    width : int
        Number of columns.
    wanted : tuple of int
        Columns of x, y and z, then of red, green and blue if the text has colours.
    separator : bytes or None
        The mark between columns; None for white space.
    heading : int
        Number of rows that name the columns: 0 or 1. A comment is not a row.
    """

    width: int
    wanted: tuple[int, ...]
    separator: bytes | None
    heading: int


def read_xyz(path: Path, budget: Budget) -> PointCloud:
    """Return the points of a text with one point a line, and their colours if it has them.

    Commas, semicolons or white space separate the columns. The first line may name them in any order: x, y,
    z and red, green, blue (or r, g, b); other columns are skipped. Without names, a text has three columns,
    or six with colours. Blank lines and lines that start with # or // are skipped.
    """
    body = memoryview(budget.read(path).removeprefix(b"\xef\xbb\xbf"))
    columns = _find_columns(path, body)
    count = sum(1 for _ in _split_rows(path, body)) - columns.heading
    budget.take(path, 8 * len(columns.wanted) * count)
    numbers = np.empty((count, len(columns.wanted)))
    rows = _split_rows(path, body)
    for _ in range(columns.heading):
        next(rows)
    if not read_rows(path, rows, numbers, columns.wanted, columns.width, "point", columns.separator):
        raise FileFormatError(path, f"truncated: expected {columns.width} numbers", f"point {count - 1}")
    if len(columns.wanted) == 3:
        return PointCloud(numbers)
    try:
        return PointCloud(numbers[:, :3], scale_colors(numbers[:, 3:], False))
    except ValueError as error:
        hint = "" if columns.heading else "; if these are no colours, add a first line such as x,y,z,nx,ny,nz"
        raise FileFormatError.from_error(path, ValueError(f"{error}{hint}")) from error


def _split_rows(path: Path, body: memoryview) -> Iterator[bytes]:
    """Yield the lines that are neither blank nor a comment."""
    return (line for line in split_lines(path, body) if not line.lstrip().startswith(COMMENTS))


def _find_columns(path: Path, body: memoryview) -> Columns:
    first = next(split_lines(path, body), b"")
    row = next(_split_rows(path, body), b"")
    named = _read_names(path, first, 1 if first == row else 0)
    if named is not None:
        return named
    words = row.split(separator := _find_separator(row))
    if len(words) not in (3, 6):
        shown = row.strip()[:80].decode("latin-1")
        reason = (
            f"expected x y z or x y z red green blue, or a first line that names the columns, got {shown!r}"
        )
        raise FileFormatError(path, reason, "point 0")
    return Columns(len(words), tuple(range(len(words))), separator, 0)


def _read_names(path: Path, line: bytes, heading: int) -> Columns | None:
    """Return the columns that a line names, or None."""
    line = line.lstrip(b"#/ \t")
    separator = _find_separator(line)
    names = [word.decode("latin-1").strip(' \t\r"').lower() for word in line.split(separator)]
    if not {"x", "y", "z"} <= set(names):
        return None
    colors = next((three for three in COLORS if set(three) <= set(names)), ())
    wanted = ("x", "y", "z", *colors)
    if any(names.count(name) > 1 for name in wanted):
        raise FileFormatError(path, "expected columns of different names", "line 1")
    return Columns(len(names), tuple(names.index(name) for name in wanted), separator, heading)


def _find_separator(line: bytes) -> bytes | None:
    return next((mark for mark in (b";", b",") if mark in line), None)
