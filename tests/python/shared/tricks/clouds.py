"""Tricks with point clouds: PLY, PCD and text."""

from __future__ import annotations

import struct
from collections.abc import Callable

import strand
from shared.tricks import MAX_BYTES, Trick, try_files

Make = Callable[[], bytes]
NEAR = MAX_BYTES - (1 << 12)  # bytes after the header of a file that just fits
MANY = 10**17  # rows that are not there
XYZ = "property float x\nproperty float y\nproperty float z\n"
COLORS = "property uchar red\nproperty uchar green\nproperty uchar blue\n"
ROW = b"0 0 1\n"
_COPY = b"\xe0\xff\0"  # LZF's copy of 264 bytes
_FIT = 50_000  # points that take about the limit with colours


def list_tricks() -> list[Trick]:
    """Return the tricks with point clouds."""
    refused: dict[str, dict[str, Make]] = {
        "ply of more than fits": {
            "bytes": lambda: make_ply("binary_little_endian", 12 << 20, XYZ, bytes(100 << 20)),
            "floats": lambda: make_ply("binary_little_endian", NEAR // 12, XYZ, bytes(NEAR // 12 * 12)),
            "doubles": lambda: make_ply(
                "binary_big_endian", NEAR // 24, XYZ.replace("float", "double"), bytes(NEAR // 24 * 24)
            ),
            "a double": lambda: make_ply(
                "binary_little_endian", NEAR // 16, XYZ.replace("float z", "double z"), bytes(NEAR // 16 * 16)
            ),
            "colours": lambda: make_ply(
                "binary_little_endian", NEAR // 15, XYZ + COLORS, bytes(NEAR // 15 * 15)
            ),
            "ascii": lambda: make_ply("ascii", NEAR // 6, XYZ, ROW * (NEAR // 6)),
        },
        "ply of rows that are not there": {
            "binary": lambda: make_ply("binary_little_endian", MANY, XYZ, bytes(12)),
            "ascii": lambda: make_ply("ascii", MANY, XYZ, ROW),
            "before": lambda: _add_rows_before("binary_little_endian", MANY, b""),
            "blank": lambda: make_ply("ascii", NEAR // 100, XYZ, ROW + b"\n" * (NEAR // 2)),
            "a long number": lambda: make_ply("ascii", int("9" * 4000), XYZ, ROW),
        },
        "ply of long lines": {
            "a header line": lambda: b"ply\ncomment " + b"a" * NEAR,
            "a header without end": lambda: b"ply\n" + b"comment a\n" * (NEAR // 10),
            "digits": lambda: make_ply("ascii", 100, XYZ, b"0" * NEAR),
            "numbers": lambda: make_ply("ascii", 100, XYZ, b"0 " * (NEAR // 2)),
        },
        "ply of lists": {
            "in vertices": lambda: make_ply(
                "ascii", 9, XYZ + "property list uchar int a\n", b"0 0 1 0\n" * 9
            ),
            "before them": lambda: _add_rows_before("ascii", 9, b"0\n" * 9, "list uint int"),
        },
        "pcd of more than fits": {
            "floats": lambda: make_pcd("binary", NEAR // 12, bytes(NEAR)),
            "doubles": lambda: make_pcd("binary", NEAR // 24, bytes(NEAR), size=8),
            "colours": lambda: make_pcd("binary", NEAR // 16, bytes(NEAR), "U 4 1 rgb"),
            "ascii": lambda: make_pcd("ascii", NEAR // 6, ROW * (NEAR // 6)),
            "a header line": lambda: b"VERSION .7\n# " + b"a" * NEAR,
            "an ascii line": lambda: make_pcd("ascii", 9, b"0" * NEAR),
            "an ascii field": lambda: make_pcd("ascii", 1, b"0 " * (NEAR // 2), f"U 1 {NEAR // 2 - 3} a"),
        },
        "pcd of points that are not there": {
            "binary": lambda: make_pcd("binary", MANY, bytes(12)),
            "ascii": lambda: make_pcd("ascii", MANY, ROW),
            "compressed": lambda: make_pcd("binary_compressed", MANY, struct.pack("<II", 3, (1 << 32) - 1)),
            "a field": lambda: make_pcd("binary", 1, bytes(12), f"U 1 {MANY} a"),
            "an ascii field": lambda: make_pcd("ascii", 1, ROW, f"U 1 {MANY} a"),
        },
        "pcd of lzf": {
            "1 GiB": lambda: _compress(1 << 30, 1 << 30),
            "what nearly fits": lambda: _compress(15 << 20, 15 << 20),
            "less than it declares": lambda: _compress(5 << 20, 4 << 20),
            "more than it declares": lambda: _compress(1 << 20, 1 << 30),
            "single bytes": lambda: _pack(3 << 20, b"\0\0" * (3 << 20)),
            "short copies": lambda: _pack(5 << 20, b"\2\0\0\0" + b"\x20\0" * (5 << 20)),
        },
        "text of long lines": {
            "100 MB": lambda: b"0 " * (50 << 20),
            "what nearly fits": lambda: b"0 " * (NEAR // 2),
            "zeros": lambda: bytes(NEAR),
            "carriage returns": lambda: b"0 0 1\r" * (NEAR // 6),
            "digits": lambda: (b"0 0 " + b"1" * 65_000 + b"\n") * (NEAR // 65_005),
            "names": lambda: (b"x,y,z" + b"," * 65_000 + b"\n") * 200,
        },
        "text of many lines": {
            "points": lambda: ROW * (NEAR // 6),
            "colours": lambda: b"0,0,1,9,9,9\n" * (NEAR // 12),
            "comments": lambda: b"#\n" * (NEAR // 2),
            "short ones": lambda: ROW + b"0\n" * (NEAR // 2 - 3),
            "blank ones": lambda: b"\n" * NEAR,
        },
    }
    answered: dict[str, Make] = {
        "ply of doubles and colours within the limit": lambda: make_ply(
            "binary_big_endian", _FIT, XYZ.replace("float", "double") + COLORS, bytes(27 * _FIT)
        ),
        "ply of ascii within the limit": lambda: make_ply(
            "ascii", _FIT, XYZ + COLORS, b"0 0 1 9 9 9\n" * _FIT
        ),
        "ply of long numbers": lambda: make_ply("ascii", 200, XYZ, (b"0 0 " + b"1" * 60_000 + b"\n") * 200),
        "ply of many properties": lambda: make_ply(
            "binary_little_endian",
            1,
            XYZ + "".join(f"property char {i}\n" for i in range(3000)),
            bytes(3012),
        ),
        "pcd of ascii within the limit": lambda: make_pcd("ascii", _FIT, b"0 0 1 9\n" * _FIT, "U 4 1 rgb"),
        "pcd of lzf within the limit": lambda: _compress(1 << 20, 1 << 20),
        "text within the limit": lambda: b"0 0 1 9 9 9\n" * _FIT,
        "text of many columns": lambda: (
            b"x,y,z" + b",a" * 30_000 + b"\n" + (b"0,0,0" + b",0" * 30_000 + b"\n") * 200
        ),
    }
    return [
        *(_try(name, makes) for name, makes in refused.items()),
        *(_try(name, {"": make}, True) for name, make in answered.items()),
    ]


def _try(name: str, makes: dict[str, Make], answered: bool = False) -> Trick:
    suffix = name.split()[0].replace("text", "csv")
    return try_files(
        name,
        makes,
        f"a.{suffix}",
        lambda file: strand.load_scene(file, camera_frame=True, max_bytes=MAX_BYTES),
        answered,
    )


def make_ply(kind: str, rows: int, columns: str, body: bytes) -> bytes:
    """Return a PLY file of so many vertices."""
    return f"ply\nformat {kind} 1.0\nelement vertex {rows}\n{columns}end_header\n".encode() + body


def _add_rows_before(kind: str, rows: int, body: bytes, column: str = "char") -> bytes:
    """Return a PLY file with rows of another element before its vertex."""
    before = f"ply\nformat {kind} 1.0\nelement other {rows}\nproperty {column} a\n"
    return before.encode() + make_ply(kind, 1, XYZ, body).partition(b"1.0\n")[2]


def make_pcd(kind: str, points: int, body: bytes, more: str = "", size: int = 4) -> bytes:
    """Return a PCD file; `more` has type, size, count and name of another field."""
    rows = [["F", str(size), "1", axis] for axis in "xyz"] + ([more.split()] if more else [])
    kinds, sizes, counts, names = (" ".join(words) for words in zip(*rows, strict=True))
    head = f"VERSION .7\nFIELDS {names}\nSIZE {sizes}\nTYPE {kinds}\nCOUNT {counts}\n"
    return head.encode() + f"WIDTH {points}\nHEIGHT 1\nDATA {kind}\n".encode() + body


def _pack(size: int, packed: bytes) -> bytes:
    """Return a compressed PCD file that declares its size."""
    size = size // 12 * 12
    return make_pcd("binary_compressed", size // 12, struct.pack("<II", len(packed), size) + packed)


def _compress(declared: int, size: int) -> bytes:
    """Return a compressed PCD file of zeros, which may declare another size."""
    size = size // 12 * 12 - 1
    rest = size % 264
    return _pack(declared, b"\0\0" + _COPY * (size // 264) + b"\0\0" * rest)
