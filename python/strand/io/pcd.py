"""Read points, colours and viewpoint from PCD files: ASCII, binary and compressed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import MAX_HEADER, Budget
from strand.io.lzf import MAX_GROWTH, decompress
from strand.io.point_cloud import PointCloud
from strand.io.text_rows import is_long_enough, read_rows, split_lines
from strand.support.files import FileFormatError

KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
TYPES = {  # NumPy's name of each TYPE and SIZE
    **{("F", "4"): "<f4", ("F", "8"): "<f8"},
    **{("I", "1"): "<i1", ("I", "2"): "<i2", ("I", "4"): "<i4", ("I", "8"): "<i8"},
    **{("U", "1"): "<u1", ("U", "2"): "<u2", ("U", "4"): "<u4", ("U", "8"): "<u8"},
}

_COUNT = re.compile(r"\d{1,18}")
_COLOR_TYPES = ("<f4", "<u4", "<i4")  # types that colours are packed in


@dataclass(frozen=True)
class Header:
    """The header of a PCD file.

    Attributes
    ----------
    fields : tuple of (str, str, int)
        Name, NumPy type and count of each field.
    points : int
        Number of points.
    viewpoint : (3,) tuple of float
        Position of the sensor, metres.
    encoding : str
        A key of `_READERS`.
    """

    fields: tuple[tuple[str, str, int], ...]
    points: int
    viewpoint: tuple[float, ...]
    encoding: str

    @property
    def kinds(self) -> dict[str, str]:
        """NumPy type of each field with one number a point."""
        return {name: kind for name, kind, count in self.fields if count == 1}

    def find_positions(self, wanted: list[str]) -> dict[str, int]:
        """Return the index of each wanted field among the fields."""
        names = [name for name, _, _ in self.fields]
        return {name: names.index(name) for name in wanted}

    @property
    def sizes(self) -> list[int]:
        """Bytes of each field in a point."""
        return [np.dtype(kind).itemsize * count for _, kind, count in self.fields]


def read_pcd(path: Path, budget: Budget) -> PointCloud:
    """Return the points of a PCD file, with colours if it has rgb or rgba.

    The viewpoint comes from the header. The origin counts as none, as writers leave it there by default.
    """
    data = budget.read(path)
    end = re.search(rb"(?:^|\n)DATA[ \t][^\n]*\n", data[:MAX_HEADER])
    if end is None or re.match(rb"(?:\s|#[^\n]*\n)*VERSION\s", data[:MAX_HEADER]) is None:
        raise FileFormatError(path, "truncated, or not a PCD file")
    header = _parse_header(path, data[: end.end()])
    kinds = header.kinds
    if any(kinds.get(axis) not in ("<f4", "<f8") for axis in "xyz"):
        raise FileFormatError(path, "expected points with x, y and z of TYPE F", "FIELDS")
    color = next((name for name in ("rgb", "rgba") if kinds.get(name) in _COLOR_TYPES), None)
    wanted = ["x", "y", "z", *([] if color is None else [color])]
    body = memoryview(data)[end.end() :]
    kind = np.result_type(*(kinds[axis] for axis in "xyz"))
    _require_room(path, header, body)
    budget.take(path, (3 * kind.itemsize + (0 if color is None else 8)) * header.points)
    columns = _READERS[header.encoding](path, budget, body, header, wanted)
    points = np.empty((header.points, 3), dtype=kind)
    with np.errstate(over="ignore"):  # numbers too large for a float become infinite
        for i, axis in enumerate("xyz"):
            points[:, i] = columns[axis].astype(kinds[axis])
    try:
        colors = None
        if color is not None:
            numbers = columns[color]
            if header.encoding == "ascii":  # points without a return may have NaN for a colour
                numbers = np.where(np.isnan(numbers) & ~np.isfinite(points).all(axis=1), 0, numbers)
            colors = _unpack_colors(numbers, kinds[color])
    except ValueError as error:
        raise FileFormatError(path, str(error), color) from error
    return PointCloud(points, colors, np.array(header.viewpoint) if any(header.viewpoint) else None)


def _unpack_colors(numbers: NDArray[Any], kind: str) -> NDArray[np.uint8]:
    """Return (N, 3) colours from packed numbers, whose bytes are blue, green, red and one unused."""
    if numbers.dtype != kind:  # read from text as float64
        info = np.iinfo(kind) if kind != "<f4" else np.finfo(kind)
        if numbers.size and not (numbers.min() >= info.min and numbers.max() <= info.max):
            raise ValueError(f"expected numbers of type {kind}, got {numbers.min()} to {numbers.max()}")
    packed = np.ascontiguousarray(numbers, dtype=kind).view(np.uint8).reshape(-1, 4)
    return packed[:, 2::-1]


def _parse_header(path: Path, text: bytes) -> Header:
    """Read the header, which ends with the line of DATA."""
    entries: dict[str, list[str]] = {}
    for number, line in enumerate(text.decode("latin-1").split("\n"), 1):
        key, *words = line.split() or ["#"]
        if key.startswith("#"):
            continue
        if key not in KEYS or key in entries or not words:
            raise FileFormatError(path, f"not understood: {line.strip()[:80]!r}", f"line {number}")
        entries[key] = words
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT") if key not in entries]
    if missing:
        raise FileFormatError(path, f"missing {', '.join(missing)}", "header")
    names = entries["FIELDS"]
    counts = entries.get("COUNT", ["1"] * len(names))
    if not len(names) == len(entries["SIZE"]) == len(entries["TYPE"]) == len(counts):
        raise FileFormatError(path, "expected FIELDS, SIZE, TYPE and COUNT of one length", "header")
    fields = []
    for name, letter, size, count in zip(names, entries["TYPE"], entries["SIZE"], counts, strict=True):
        if (letter, size) not in TYPES or not _COUNT.fullmatch(count) or not int(count):
            raise FileFormatError(
                path, f"not understood: TYPE {letter}, SIZE {size}, COUNT {count}"[:200], f"field {name[:80]}"
            )
        fields.append((name, TYPES[letter, size], int(count)))
    named = [name for name in names if name != "_"]  # "_" marks padding
    if len(set(named)) < len(named):
        raise FileFormatError(path, "expected fields of different names", "FIELDS")
    width, height = _parse_count(path, entries, "WIDTH"), _parse_count(path, entries, "HEIGHT")
    points = _parse_count(path, entries, "POINTS") if "POINTS" in entries else width * height
    if points != width * height:
        raise FileFormatError(path, f"expected WIDTH x HEIGHT = {width * height}, got {points}", "POINTS")
    encoding = entries["DATA"][0]
    if encoding not in _READERS:
        raise FileFormatError(path, f"expected one of {', '.join(_READERS)}, got {encoding[:80]!r}", "DATA")
    return Header(tuple(fields), points, _parse_viewpoint(path, entries), encoding)


def _parse_count(path: Path, entries: dict[str, list[str]], key: str) -> int:
    word = entries[key][0]
    if not _COUNT.fullmatch(word):
        raise FileFormatError(path, f"expected a whole number, got {word[:80]!r}", key)
    return int(word)


def _parse_viewpoint(path: Path, entries: dict[str, list[str]]) -> tuple[float, ...]:
    """Return the (3,) position of the sensor; its orientation is not needed, as rays only start there."""
    words = entries.get("VIEWPOINT", ["0"] * 7)
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) != 7 or not np.isfinite(numbers).all():
        raise FileFormatError(path, f"expected seven numbers, got {' '.join(words)[:80]!r}", "VIEWPOINT")
    return numbers[:3]


def _require_room(path: Path, header: Header, body: memoryview) -> None:
    """Raise an error if the bytes after the header cannot hold all points."""
    if header.encoding == "ascii":
        enough = is_long_enough(body, header.points * sum(count for _, _, count in header.fields))
    else:
        growth = MAX_GROWTH if header.encoding == "binary_compressed" else 1
        enough = header.points * sum(header.sizes) <= len(body) * growth
    if not enough:
        raise _make_truncated_error(path, header)


def _make_truncated_error(path: Path, header: Header) -> FileFormatError:
    return FileFormatError(path, f"truncated, fewer than {header.points} whole points")


def _read_ascii_columns(
    path: Path, budget: Budget, body: memoryview, header: Header, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    starts = [0, *accumulate(count for _, _, count in header.fields)]
    places = [starts[at] for at in header.find_positions(wanted).values()]
    budget.take(path, 8 * len(wanted) * header.points)
    numbers = np.empty((header.points, len(wanted)))
    if not read_rows(path, split_lines(path, body), numbers, places, starts[-1], "point"):
        raise _make_truncated_error(path, header)
    return dict(zip(wanted, numbers.T, strict=True))


def _read_binary_columns(
    path: Path, budget: Budget, body: memoryview, header: Header, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    starts, positions = [0, *accumulate(header.sizes)], header.find_positions(wanted)
    row = np.dtype(
        {
            "names": wanted,
            "formats": [header.kinds[name] for name in wanted],
            "offsets": [starts[positions[name]] for name in wanted],
            "itemsize": starts[-1],
        }
    )
    table = np.frombuffer(body, row, header.points) if header.points else np.empty(0, row)
    return {name: table[name] for name in wanted}


def _read_compressed_columns(
    path: Path, budget: Budget, body: memoryview, header: Header, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    """Return the wanted columns of a body that is compressed as a whole, one field after the other."""
    if len(body) < 8:
        raise _make_truncated_error(path, header)
    packed, size = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
    expected = header.points * sum(header.sizes)
    if size != expected:
        raise FileFormatError(path, f"expected {expected} bytes when decompressed, got {size}", "DATA")
    if packed > len(body) - 8:
        raise FileFormatError(path, f"truncated: {len(body) - 8} of {packed} compressed bytes")
    budget.take(path, size)
    try:
        held = decompress(body[8 : 8 + packed], size)
    except ValueError as error:
        raise FileFormatError(path, f"truncated or damaged ({error})", "DATA") from error
    starts = [0, *accumulate(header.points * one for one in header.sizes)]
    return {
        name: np.ndarray(header.points, header.kinds[name], held, starts[at])
        for name, at in header.find_positions(wanted).items()
    }


_READERS = {
    "ascii": _read_ascii_columns,
    "binary": _read_binary_columns,
    "binary_compressed": _read_compressed_columns,
}
