"""Tricks with images: headers, scans, chunks and tags that declare much."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

import strand
from shared.scene_files import CAMERA, DEPTH, IDENTITY, save_png, write_scene
from shared.tricks import MAX_BYTES, Trick

SIDE = 9000  # pixels of a large image
_SCANS = 5000  # scans of a JPEG


def list_tricks() -> list[Trick]:
    """Return the tricks with images."""
    colors = {
        "png of 16-bit RGBA": lambda: make_png(SIDE, SIDE, 16, 6),
        "png of 8-bit palette": lambda: make_png(SIDE, SIDE, 8, 3, [(b"PLTE", bytes(3))]),
        "png interlaced": lambda: make_png(SIDE, SIDE, 16, 6, interlaced=1),
        "png of many chunks": lambda: make_png(8, 6, 8, 2, [(b"abCd", b"")] * 500_000),
        "png of texts": lambda: make_png(
            8, 6, 8, 2, [(b"zTXt", b"a\0\0" + zlib.compress(bytes(1_000_000), 9))] * 60
        ),
        "png of profiles": lambda: make_png(
            8, 6, 8, 2, [(b"iCCP", b"a\0\0" + zlib.compress(bytes(10**8), 9))]
        ),
        "png of a long row": lambda: make_png(80_000_000, 1, 8, 2),
        "jpeg of large pixels": lambda: make_jpeg(SIDE, SIDE),
        "jpeg of many scans": lambda: repeat_scans(make_jpeg(8, 6, progressive=True), 20_000),
        "jpeg of large scans": lambda: repeat_scans(make_jpeg(4000, 4000, progressive=True), _SCANS),
        "jpeg of fill bytes": lambda: b"\xff\xd8" + b"\xff" * 7_000_000 + make_jpeg(8, 6)[2:],
        "jpeg of junk": lambda: b"\xff\xd8\xff\xf0" + bytes(7_000_000) + make_jpeg(8, 6)[2:],
        "jpeg of comments": lambda: b"\xff\xd8" + b"\xff\xfe\0\2" * 1_700_000 + make_jpeg(8, 6)[2:],
        "jpeg of exif tags": lambda: add_exif(make_jpeg(8, 6)),
        "jpeg of mpo tags": lambda: add_segment(make_jpeg(8, 6), 0xE2, b"MPF\0" + make_tags(60_000)),
        "bmp of runs": lambda: make_bmp(10_000, 10_000),
        "bmp of large pixels": lambda: (
            b"BM" + struct.pack("<IIIIIIHHIIIIII", 0, 0, 54, 40, SIDE, SIDE, 1, 24, *[0] * 6)
        ),
        "ppm of words": lambda: b"P3 2000 2000 255 " + b"1 " * 3_500_000,
        "ppm of another maximum": lambda: b"P6 1500 1500 200 " + bytes(6_750_000),
        "ppm of a comment": lambda: b"P6 #" + b"a" * 7_000_000,
        "ppm of blanks": lambda: b"P6" + b" " * 7_000_000,
        "webp": lambda: save_image((1000, 1000), "WEBP"),
        "gif": lambda: save_image((1000, 1000), "GIF"),
    }
    metadata = ("png of texts", "png of profiles", "jpeg of exif tags", "jpeg of mpo tags")
    found = [_try_color(name, make, name in metadata) for name, make in colors.items()]
    found += [
        _try_mask("png as a mask", lambda: make_png(SIDE, SIDE, 16, 0)),
        _try_mask("png of 1 bit as a mask", lambda: make_png(SIDE, SIDE, 1, 0)),
        _try_depth("png as depth", "a.png", lambda: make_png(SIDE, SIDE, 16, 0)),
        _try_depth("png as depth within the limit", "a.png", lambda: make_png(700, 700, 16, 0), True),
        _try_depth("tiff as depth", "a.tiff", lambda: make_tiff(SIDE, SIDE, SIDE)),
        _try_depth("tiff of one place", "a.tiff", make_tiff_of_one_place),
        _try_depth("tiff of many tags", "a.tiff", lambda: _tag_tiff(range(40_000, 60_000)), True),
        _try_depth("tiff of many strips", "a.tiff", make_tiff_of_strips),
        _try_depth("tiff of inner directories", "a.tiff", lambda: _tag_tiff([34665, 34853]), True),
    ]
    return found


def _try_color(name: str, make: Callable[[], bytes], answered: bool) -> Trick:
    def write(folder: Path) -> None:
        save_png(folder / "a.png")
        (folder / "c").write_bytes(make())
        write_scene(folder, "a.png", CAMERA, IDENTITY + 'color = "c"\n')

    return Trick(name, write, lambda folder: strand.load_scene(folder, max_bytes=MAX_BYTES), answered)


def _try_mask(name: str, make: Callable[[], bytes]) -> Trick:
    def write(folder: Path) -> None:
        save_png(folder / "a.png")
        (folder / "m.png").write_bytes(make())
        write_scene(folder, "a.png", CAMERA, IDENTITY + 'mask = "m.png"\n')

    return Trick(name, write, lambda folder: strand.load_scene(folder, max_bytes=MAX_BYTES))


def _try_depth(name: str, file: str, make: Callable[[], bytes], answered: bool = False) -> Trick:
    return Trick(
        name,
        lambda folder: (folder / file).write_bytes(make()),
        lambda folder: strand.load_scene(
            folder / file, intrinsics=np.eye(3), depth_scale=0.001, max_bytes=MAX_BYTES
        ),
        answered,
    )


def make_chunk(kind: bytes, data: bytes) -> bytes:
    """Return a chunk of a PNG."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def make_png(
    width: int,
    height: int,
    bits: int,
    color: int,
    chunks: Sequence[tuple[bytes, bytes]] = (),
    interlaced: int = 0,
) -> bytes:
    """Return a black PNG with other chunks after its header."""
    samples = {0: 1, 2: 3, 3: 1, 6: 4}[color]
    row = bytes(1 + (width * bits * samples + 7) // 8)
    packer, packed = zlib.compressobj(9), []
    for _ in range(height):
        packed.append(packer.compress(row))
    packed.append(packer.flush())
    header = struct.pack(">IIBBBBB", width, height, bits, color, 0, 0, interlaced)
    cache: dict[tuple[bytes, bytes], bytes] = {}
    middle = b"".join(cache.setdefault(one, make_chunk(*one)) for one in chunks)
    parts = [
        make_chunk(b"IHDR", header),
        middle,
        make_chunk(b"IDAT", b"".join(packed)),
        make_chunk(b"IEND", b""),
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def save_image(size: tuple[int, int], kind: str, mode: str = "RGB", **how: object) -> bytes:
    """Return a black image of one of Pillow's formats."""
    out = io.BytesIO()
    Image.new(mode, size).save(out, kind, **how)
    return out.getvalue()


def make_jpeg(width: int, height: int, progressive: bool = False) -> bytes:
    """Return a black JPEG."""
    return save_image((width, height), "JPEG", progressive=progressive)


def repeat_scans(data: bytes, scans: int) -> bytes:
    """Return a progressive JPEG whose last scan comes many times."""
    last = data.rindex(b"\xff\xda")
    return data[:last] + data[last:-2] * scans + data[-2:]


def add_segment(data: bytes, marker: int, content: bytes) -> bytes:
    """Return a JPEG with another segment at its start."""
    return data[:2] + struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content + data[2:]


def make_tags(size: int) -> bytes:
    """Return a directory of as many tags as fit, of which each has all bytes as its data."""
    count = min((size - 14) // 12, 60_000)
    entries = b"".join(struct.pack("<HHII", 1000 + i, 7, size, 0) for i in range(count))
    return (b"II*\0" + struct.pack("<IH", 8, count) + entries + bytes(size))[:size]


def add_exif(data: bytes) -> bytes:
    """Return a JPEG whose EXIF is in many segments, and whose tags have all of it each."""
    whole = make_tags(900_000)
    parts = [whole[at : at + 60_000] for at in range(0, len(whole), 60_000)]
    for part in reversed(parts):
        data = add_segment(data, 0xE1, b"Exif\0\0" + part)
    return data


def make_bmp(width: int, height: int) -> bytes:
    """Return a BMP of runs, which Pillow decodes byte by byte."""
    header = struct.pack("<IIIIIIHHIIIIII", 0, 0, 1078, 40, width, height, 1, 8, 1, *[0] * 5)
    return b"BM" + header + bytes(1024) + b"\1\0" * 3_500_000


def make_tiff(width: int, height: int, rows: int) -> bytes:
    """Return a small TIFF of 16-bit depth in deflated strips of many rows."""
    out = io.BytesIO()
    tifffile.imwrite(out, np.zeros((height, width), np.uint16), compression="zlib", rowsperstrip=rows)
    return out.getvalue()


def pack_tags(tags: dict[int, tuple[int, int, int]], body: bytes) -> bytes:
    """Return a TIFF with tags, each of a kind, a count and a value or place, before its body."""
    entries = b"".join(struct.pack("<HHII", tag, *tags[tag]) for tag in sorted(tags))
    return b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4) + body


def _list_tags(width: int, height: int, rows: int, method: int) -> dict[int, tuple[int, int, int]]:
    numbers = {256: width, 257: height, 258: 16, 259: method, 262: 1, 277: 1, 278: rows, 339: 1}
    return {tag: (4 if tag in (256, 257, 278) else 3, 1, value) for tag, value in numbers.items()}


def make_tiff_of_one_place() -> bytes:
    """Return a TIFF of thousands of strips, which are the same millions of bytes each."""
    strips, size = 60_000, 7_000_000
    packed = zlib.compress(bytes(2)) + bytes(size)
    tags = _list_tags(1, strips, 1, 8)
    place = 8 + 2 + 12 * (len(tags) + 2) + 4
    tags[273], tags[279] = (4, strips, place), (4, strips, place + 4 * strips)
    body = struct.pack("<I", place + 8 * strips) * strips + struct.pack("<I", size) * strips + packed
    return pack_tags(tags, body)


def make_tiff_of_strips() -> bytes:
    """Return a TIFF of 8 x 6 pixels that declares millions of strips."""
    strips = 1_500_000
    tags = _list_tags(8, 6, 1, 1)
    place = 8 + 2 + 12 * (len(tags) + 2) + 4
    tags[273], tags[279] = (4, strips, place), (3, 1, 16)
    return pack_tags(tags, struct.pack("<I", place) * strips)


def _tag_tiff(more: range | list[int]) -> bytes:
    """Return a TIFF of 8 x 6 pixels with other tags, which all have the same million of bytes."""
    tags = _list_tags(8, 6, 6, 1)
    tags |= {tag: (4 if tag < 40_000 else 7, 1 if tag < 40_000 else 1_000_000, 8) for tag in more}
    place = 8 + 2 + 12 * (len(tags) + 2) + 4
    tags[273], tags[279] = (4, 1, place), (4, 1, DEPTH.nbytes)
    return pack_tags(tags, DEPTH.tobytes() + bytes(1_000_000))
