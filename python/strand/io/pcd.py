"""Points, colours and viewpoint of PCD files: ASCII, binary and compressed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.lzf import MOST_GROWTH, decompress
from strand.io.point_cloud import PointCloud
from strand.io.text_rows import is_long_enough, read_rows, split_lines
from strand.support.files import FileFormatError

HEADER_BYTES = 1 << 16
KEYS = ("VERSION", "FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA")
TYPES = {
    **{("F", "4"): "<f4", ("F", "8"): "<f8"},
    **{("I", "1"): "<i1", ("I", "2"): "<i2", ("I", "4"): "<i4", ("I", "8"): "<i8"},
    **{("U", "1"): "<u1", ("U", "2"): "<u2", ("U", "4"): "<u4", ("U", "8"): "<u8"},
}

_COUNT = re.compile(r"\d{1,18}")
_COLOR_TYPES = ("<f4", "<u4", "<i4")


@dataclass(frozen=True)
class Header:
    """What a PCD file says before its points.

    Attributes
    ----------
    fields : tuple of (str, str, int)
        Name, NumPy type and count of each field.
    points : int
        How many points there are.
    viewpoint : (3,) tuple of float
        Where the sensor stood, metres.
    encoding : str
        One of those of `_READERS`.
    """

    fields: tuple[tuple[str, str, int], ...]
    points: int
    viewpoint: tuple[float, ...]
    encoding: str

    @property
    def kinds(self) -> dict[str, str]:
        """NumPy type of each field that has one number."""
        return {name: kind for name, kind, count in self.fields if count == 1}

    def positions(self, wanted: list[str]) -> dict[str, int]:
        """Where among the fields some are."""
        names = [name for name, _, _ in self.fields]
        return {name: names.index(name) for name in wanted}

    @property
    def sizes(self) -> list[int]:
        """How many bytes each field takes in a point."""
        return [np.dtype(kind).itemsize * count for _, kind, count in self.fields]


def read_pcd(path: Path, budget: Budget) -> PointCloud:
    """Return the points of a PCD file, with their colours if there is rgb or rgba.

    Its viewpoint is that of the header, unless that is the origin: there it stands where nobody set it.

    Raises
    ------
    strand.FileFormatError
        If it is truncated or is something else, has points without float x, y and z, or takes more than the
        budget.
    """
    data = budget.read(path)
    end = re.search(rb"(?:^|\n)DATA[ \t][^\n]*\n", data[:HEADER_BYTES])
    if end is None or re.match(rb"(?:\s|#[^\n]*\n)*VERSION\s", data[:HEADER_BYTES]) is None:
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
    with np.errstate(over="ignore"):  # what a float does not hold is infinite
        for i, axis in enumerate("xyz"):
            points[:, i] = columns[axis].astype(kinds[axis])
    try:
        colors = None
        if color is not None:
            numbers = columns[color]
            if header.encoding == "ascii":  # of no returns, colours may be NaN
                numbers = np.where(np.isnan(numbers) & ~np.isfinite(points).all(axis=1), 0, numbers)
            colors = _unpacked(numbers, kinds[color])
    except ValueError as error:
        raise FileFormatError(path, str(error), color) from error
    return PointCloud(points, colors, np.array(header.viewpoint) if any(header.viewpoint) else None)


def _unpacked(numbers: NDArray[Any], kind: str) -> NDArray[np.uint8]:
    """(N, 3) Colours of numbers whose bytes are blue, green and red, and one that is not needed."""
    if numbers.dtype != kind:  # as text
        info = np.iinfo(kind) if kind != "<f4" else np.finfo(kind)
        if numbers.size and not (numbers.min() >= info.min and numbers.max() <= info.max):
            raise ValueError(f"expected numbers of type {kind}, got {numbers.min()} to {numbers.max()}")
    packed = np.ascontiguousarray(numbers, dtype=kind).view(np.uint8).reshape(-1, 4)
    return packed[:, 2::-1]


def _parse_header(path: Path, text: bytes) -> Header:
    """Read the lines up to that of DATA."""
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
    named = [name for name in names if name != "_"]  # what is not used
    if len(set(named)) < len(named):
        raise FileFormatError(path, "expected fields of different names", "FIELDS")
    width, height = _number(path, entries, "WIDTH"), _number(path, entries, "HEIGHT")
    points = _number(path, entries, "POINTS") if "POINTS" in entries else width * height
    if points != width * height:
        raise FileFormatError(path, f"expected WIDTH x HEIGHT = {width * height}, got {points}", "POINTS")
    encoding = entries["DATA"][0]
    if encoding not in _READERS:
        raise FileFormatError(path, f"expected one of {', '.join(_READERS)}, got {encoding[:80]!r}", "DATA")
    return Header(tuple(fields), points, _viewpoint(path, entries), encoding)


def _number(path: Path, entries: dict[str, list[str]], key: str) -> int:
    word = entries[key][0]
    if not _COUNT.fullmatch(word):
        raise FileFormatError(path, f"expected a whole number, got {word[:80]!r}", key)
    return int(word)


def _viewpoint(path: Path, entries: dict[str, list[str]]) -> tuple[float, ...]:
    """(3,) Where the sensor stood. The quaternion is not needed: rays start there however it was turned."""
    words = entries.get("VIEWPOINT", ["0"] * 7)
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) != 7 or not np.isfinite(numbers).all():
        raise FileFormatError(path, f"expected seven numbers, got {' '.join(words)[:80]!r}", "VIEWPOINT")
    return numbers[:3]


def _require_room(path: Path, header: Header, body: memoryview) -> None:
    """Refuse more points than the bytes after the header can hold."""
    if header.encoding == "ascii":
        enough = is_long_enough(body, header.points * sum(count for _, _, count in header.fields))
    else:
        growth = MOST_GROWTH if header.encoding == "binary_compressed" else 1
        enough = header.points * sum(header.sizes) <= len(body) * growth
    if not enough:
        raise _too_few(path, header)


def _too_few(path: Path, header: Header) -> FileFormatError:
    return FileFormatError(path, f"truncated, fewer than {header.points} whole points")


def _ascii_columns(
    path: Path, budget: Budget, body: memoryview, header: Header, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    starts = [0, *accumulate(count for _, _, count in header.fields)]
    places = [starts[at] for at in header.positions(wanted).values()]
    budget.take(path, 8 * len(wanted) * header.points)
    numbers = np.empty((header.points, len(wanted)))
    if not read_rows(path, split_lines(path, body), numbers, places, starts[-1], "point"):
        raise _too_few(path, header)
    return dict(zip(wanted, numbers.T, strict=True))


def _binary_columns(
    path: Path, budget: Budget, body: memoryview, header: Header, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    starts, positions = [0, *accumulate(header.sizes)], header.positions(wanted)
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


def _compressed_columns(
    path: Path, budget: Budget, body: memoryview, header: Header, wanted: list[str]
) -> dict[str, NDArray[Any]]:
    """Columns of what is compressed as a whole, field after field."""
    if len(body) < 8:
        raise _too_few(path, header)
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
        for name, at in header.positions(wanted).items()
    }


_READERS = {"ascii": _ascii_columns, "binary": _binary_columns, "binary_compressed": _compressed_columns}
