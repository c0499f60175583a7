"""Points and colours of text: XYZ and CSV, with or without a line of names."""

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
    """What the columns of a text are.

    Attributes
    ----------
    width : int
        How many there are.
    wanted : tuple of int
        Those of x, y and z, and of red, green and blue if there are colours.
    separator : bytes or None
        What stands between them; None: white space.
    heading : int
        How many rows name them: 0 or 1. A comment is no row.
    """

    width: int
    wanted: tuple[int, ...]
    separator: bytes | None
    heading: int


def read_xyz(path: Path, budget: Budget) -> PointCloud:
    """Return the points of a text, one a line, with their colours if there are some.

    Commas, semicolons or white space stand between the columns. The first line may name them: x, y, z, and
    red, green, blue or r, g, b, in any order and with others beside them. Without names there are three, or
    six with colours. Blank lines, and those that start with # or //, are no points.

    Raises
    ------
    strand.FileFormatError
        If a line is something else, columns are missing, or it takes more than the budget.
    """
    body = memoryview(budget.read(path).removeprefix(b"\xef\xbb\xbf"))
    columns = _columns(path, body)
    count = sum(1 for _ in _rows(path, body)) - columns.heading
    budget.take(path, 8 * len(columns.wanted) * count)
    numbers = np.empty((count, len(columns.wanted)))
    rows = _rows(path, body)
    for _ in range(columns.heading):
        next(rows)
    if not read_rows(path, rows, numbers, columns.wanted, columns.width, "point", columns.separator):
        raise FileFormatError(path, f"truncated: expected {columns.width} numbers", f"point {count - 1}")
    if len(columns.wanted) == 3:
        return PointCloud(numbers)
    try:
        return PointCloud(numbers[:, :3], scale_colors(numbers[:, 3:], False))
    except ValueError as error:
        hint = "" if columns.heading else "; a first line such as x,y,z,nx,ny,nz says that there are none"
        raise FileFormatError.from_error(path, ValueError(f"{error}{hint}")) from error


def _rows(path: Path, body: memoryview) -> Iterator[bytes]:
    """Lines that are neither blank nor a comment."""
    return (line for line in split_lines(path, body) if not line.lstrip().startswith(COMMENTS))


def _columns(path: Path, body: memoryview) -> Columns:
    first = next(split_lines(path, body), b"")
    row = next(_rows(path, body), b"")
    named = _named(path, first, 1 if first == row else 0)
    if named is not None:
        return named
    words = row.split(separator := _separator(row))
    if len(words) not in (3, 6):
        shown = row.strip()[:80].decode("latin-1")
        reason = (
            f"expected x y z or x y z red green blue, or a first line that names the columns, got {shown!r}"
        )
        raise FileFormatError(path, reason, "point 0")
    return Columns(len(words), tuple(range(len(words))), separator, 0)


def _named(path: Path, line: bytes, heading: int) -> Columns | None:
    """Return the columns that a line names, if it does."""
    line = line.lstrip(b"#/ \t")
    separator = _separator(line)
    names = [word.decode("latin-1").strip(' \t\r"').lower() for word in line.split(separator)]
    if not {"x", "y", "z"} <= set(names):
        return None
    colors = next((three for three in COLORS if set(three) <= set(names)), ())
    wanted = ("x", "y", "z", *colors)
    if any(names.count(name) > 1 for name in wanted):
        raise FileFormatError(path, "expected columns of different names", "line 1")
    return Columns(len(names), tuple(names.index(name) for name in wanted), separator, heading)


def _separator(line: bytes) -> bytes | None:
    return next((mark for mark in (b";", b",") if mark in line), None)
