"""Points of PLY files, ASCII and binary."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.files import FileFormatError
from strand.io.budget import Budget

HEADER_BYTES = 1 << 16
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"},
    **{"uint32": "u4", "float32": "f4", "float64": "f8"},
}

_BLOCK = 1 << 16  # bytes of an ASCII file taken apart at once
_COUNT = re.compile(r"\d{1,18}")


@dataclass(frozen=True)
class Element:
    """A table of a PLY file.

    Attributes
    ----------
    name : str
    rows : int
    columns : tuple of (str, str)
        Name and NumPy type of each property; of a list the type is "list".
    """

    name: str
    rows: int
    columns: tuple[tuple[str, str], ...]


def read_ply(path: Path, budget: Budget) -> NDArray[Any]:
    """(N, 3) float32 or float64, the vertices of a PLY file.

    Raises
    ------
    strand.FileFormatError
        If it is truncated or is something else, has vertices without float or double x, y and z, lists before
        or in them, or takes more than the budget.
    """
    data = budget.read(path)
    start = re.match(rb"ply\r?\n", data)
    end = re.search(rb"(?:^|\n)end_header[ \t]*\r?\n", data[:HEADER_BYTES])
    if start is None or end is None:
        raise FileFormatError(path, "truncated, or not a PLY file")
    encoding, elements = _parse_header(path, data[start.end() : end.start() + 1])
    names = [element.name for element in elements]
    if "vertex" not in names:
        raise FileFormatError(path, "expected a vertex element, got none", "header")
    before, element = elements[: names.index("vertex")], elements[names.index("vertex")]
    kinds = dict(element.columns)
    if len(kinds) < len(element.columns):
        raise FileFormatError(path, "two vertex properties of one name", "header")
    if any(kinds.get(axis) not in ("f4", "f8") for axis in "xyz"):
        raise FileFormatError(path, "expected vertices with float or double x, y and z", "header")
    if any(kind == "list" for each in (*before, element) for _, kind in each.columns):
        raise FileFormatError(path, "expected no lists in the vertices or before them", "header")
    body = memoryview(data)[end.end() :]
    with np.errstate(over="ignore"):  # what a float does not hold is infinite
        if encoding == "ascii":
            return _ascii_points(path, budget, body, before, element)
        return _binary_points(path, budget, body, ORDERS[encoding], before, element)


def _parse_header(path: Path, header: bytes) -> tuple[str, list[Element]]:
    """Read the encoding and elements of what stands between the first line and the end of the header."""
    encoding, elements = None, []
    for number, line in enumerate(header.decode("latin-1").split("\n"), 2):
        words = line.split()
        known = True
        match words:
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case ["format", kind, "1.0"] if kind in ORDERS and encoding is None:
                encoding = kind
            case ["element", name, rows] if _COUNT.fullmatch(rows):
                elements.append(Element(name, int(rows), ()))
            case ["property", "list", length, kind, name] if elements and {length, kind} <= set(TYPES):
                elements[-1] = _with_column(elements[-1], name, "list")
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1] = _with_column(elements[-1], name, TYPES[kind])
            case _:
                known = False
        if not known:
            raise FileFormatError(path, f"not understood: {line.strip()[:80]!r}", f"line {number}")
    if encoding is None:
        raise FileFormatError(path, f"expected a format: one of {', '.join(ORDERS)}", "header")
    return encoding, elements


def _with_column(element: Element, name: str, kind: str) -> Element:
    return Element(element.name, element.rows, (*element.columns, (name, kind)))


def _too_few(path: Path, element: Element) -> FileFormatError:
    return FileFormatError(path, f"truncated, fewer than {element.rows} whole vertices")


def _empty(path: Path, budget: Budget, element: Element) -> NDArray[Any]:
    """(N, 3) Room for an element's points, in the wider type of the three columns."""
    columns = dict(element.columns)
    kind = np.result_type(*(columns[axis] for axis in "xyz"))
    budget.take(path, 3 * kind.itemsize * element.rows)
    return np.empty((element.rows, 3), dtype=kind)


def _binary_points(
    path: Path, budget: Budget, body: memoryview, order: str, before: list[Element], element: Element
) -> NDArray[Any]:
    sizes = [one.rows * sum(np.dtype(kind).itemsize for _, kind in one.columns) for one in (*before, element)]
    if sum(sizes) > len(body):
        raise _too_few(path, element)
    points = _empty(path, budget, element)
    row = np.dtype([(name, order + kind) for name, kind in element.columns])
    if element.rows:
        table = np.frombuffer(body, dtype=row, count=element.rows, offset=sum(sizes[:-1]))
        for i, axis in enumerate("xyz"):
            points[:, i] = table[axis]
    return points


def _ascii_points(
    path: Path, budget: Budget, body: memoryview, before: list[Element], element: Element
) -> NDArray[Any]:
    width, skipped = len(element.columns), sum(one.rows for one in before)
    # a row has a line, and a number a digit and a space or the line's end
    if 2 * (skipped + element.rows * width) > len(body) + 1:
        raise _too_few(path, element)
    points = _empty(path, budget, element)
    names = [name for name, _ in element.columns]
    wanted = [names.index(axis) for axis in "xyz"]
    lines = _lines(path, body)
    if sum(1 for _ in islice(lines, skipped)) < skipped:
        raise _too_few(path, element)
    for i in range(element.rows):
        words = next(lines, b"").split()
        if len(words) < width and next(lines, None) is None:
            raise _too_few(path, element)
        if len(words) != width:
            raise FileFormatError(path, f"expected {width} numbers, got {len(words)}", f"vertex {i}")
        try:
            points[i] = [float(words[column]) for column in wanted]
        except ValueError:
            row = b" ".join(words)[:80].decode("latin-1")
            raise FileFormatError(path, f"expected numbers, got {row!r}", f"vertex {i}") from None
    return points


def _lines(path: Path, body: memoryview) -> Iterator[bytes]:
    """Lines that are not blank, taken apart a block at a time."""
    at, rest = 0, b""
    while at < len(body):
        *whole, rest = (rest + bytes(body[at : at + _BLOCK])).split(b"\n")
        at += _BLOCK
        if len(rest) > _BLOCK:
            raise FileFormatError(path, f"a line of more than {_BLOCK} bytes")
        yield from (line for line in whole if not line.isspace() and line)
    if rest.strip():
        yield rest
