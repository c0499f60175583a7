"""Read points and colours from PLY files, ASCII and binary."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import MAX_HEADER, Budget
from strand.io.point_cloud import PointCloud, scale_colors
from strand.io.text_rows import is_long_enough, read_rows, split_lines
from strand.support.files import FileFormatError

# NumPy's mark of each byte order
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
TYPES = {  # NumPy's name of each type
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4"},
    **{"double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4"},
    **{"uint32": "u4", "float32": "f4", "float64": "f8"},
}

_COLORS = ("red", "green", "blue")
_COUNT = re.compile(r"\d{1,18}")


@dataclass(frozen=True)
class Element:
    """A table of a PLY file.

    Attributes
    ----------
    name : str
    rows : int
    columns : tuple of (str, str)
        Name and NumPy type of each property; "list" for the type of a list.
    """

    name: str
    rows: int
    columns: tuple[tuple[str, str], ...]


def read_ply(path: Path, budget: Budget) -> PointCloud:
    """Return the vertices of a PLY file, with colours if it has red, green and blue."""
    data = budget.read(path)
    start = re.match(rb"ply\r?\n", data)
    end = re.search(rb"(?:^|\n)end_header[ \t]*\r?\n", data[:MAX_HEADER])
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
    wanted = ["x", "y", "z", *(_COLORS if set(_COLORS) <= set(kinds) else ())]
    table: Any  # columns by name
    if encoding == "ascii":
        table = _read_ascii_columns(path, budget, body, before, element, wanted)
    else:
        table = _read_binary_rows(path, body, ORDERS[encoding], before, element)
        _refuse_extra_bytes(path, body, elements)
    kind = np.result_type(*(kinds[axis] for axis in "xyz"))
    budget.take(path, (3 * kind.itemsize + (24 if _COLORS[0] in wanted else 0)) * element.rows)
    with np.errstate(over="ignore"):  # numbers too large for a float become infinite
        points = np.stack([table[axis].astype(kinds[axis]) for axis in "xyz"], axis=1).astype(kind)
    if len(wanted) == 3:
        return PointCloud(points)
    whole = all(kinds[name][0] in "iu" for name in _COLORS)
    try:
        return PointCloud(points, scale_colors(np.stack([table[name] for name in _COLORS], axis=1), whole))
    except ValueError as error:
        raise FileFormatError.from_error(path, error) from error


def _parse_header(path: Path, header: bytes) -> tuple[str, list[Element]]:
    """Return the encoding and the elements that a header declares after its first line."""
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
                elements[-1] = _add_column(elements[-1], name, "list")
            case ["property", kind, name] if elements and kind in TYPES:
                elements[-1] = _add_column(elements[-1], name, TYPES[kind])
            case _:
                known = False
        if not known:
            raise FileFormatError(path, f"not understood: {line.strip()[:80]!r}", f"line {number}")
    if encoding is None:
        raise FileFormatError(path, f"expected a format: one of {', '.join(ORDERS)}", "header")
    return encoding, elements


def _add_column(element: Element, name: str, kind: str) -> Element:
    return Element(element.name, element.rows, (*element.columns, (name, kind)))


def _make_truncated_error(path: Path, element: Element) -> FileFormatError:
    return FileFormatError(path, f"truncated, fewer than {element.rows} whole vertices")


def _read_binary_rows(
    path: Path, body: memoryview, order: str, before: list[Element], element: Element
) -> NDArray[Any]:
    """Return the (N,) vertices as a structured array with the fields of the file."""
    sizes = [one.rows * sum(np.dtype(kind).itemsize for _, kind in one.columns) for one in (*before, element)]
    if sum(sizes) > len(body):
        raise _make_truncated_error(path, element)
    row = np.dtype([(name, order + kind) for name, kind in element.columns])
    if not element.rows:
        return np.empty(0, dtype=row)
    return np.frombuffer(body, dtype=row, count=element.rows, offset=sum(sizes[:-1]))


def _refuse_extra_bytes(path: Path, body: memoryview, elements: list[Element]) -> None:
    """Refuse a file with more bytes than its header declares: some writers write rows of another width."""
    kinds = [(one.rows, kind) for one in elements for _, kind in one.columns]
    if any(kind == "list" for _, kind in kinds):  # the header does not say how long lists are
        return
    size = sum(rows * np.dtype(kind).itemsize for rows, kind in kinds)
    if bytes(body[size : size + 64]).strip():
        raise FileFormatError(path, f"expected {size} bytes after the header, got {len(body)}")


def _read_ascii_columns(
    path: Path, budget: Budget, body: memoryview, before: list[Element], element: Element, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    """Return the wanted (N,) columns of the vertices by name."""
    width, skipped = len(element.columns), sum(one.rows for one in before)
    if not is_long_enough(body, skipped + element.rows * width):
        raise _make_truncated_error(path, element)
    budget.take(path, 8 * len(wanted) * element.rows)
    numbers = np.empty((element.rows, len(wanted)))
    names = [name for name, _ in element.columns]
    each = split_lines(path, body)
    if sum(1 for _ in islice(each, skipped)) < skipped:
        raise _make_truncated_error(path, element)
    if not read_rows(path, each, numbers, [names.index(name) for name in wanted], width, "vertex"):
        raise _make_truncated_error(path, element)
    return dict(zip(wanted, numbers.T, strict=True))
