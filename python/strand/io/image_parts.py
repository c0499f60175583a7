"""Keep the parts of an image file that describe its pixels, and bound their number.

Pillow reads metadata of any size, some of them many times, and spends time on every part. So only pixels
reach it, and strand refuses what it decodes slowly.
"""

from __future__ import annotations

import re
import struct
import zlib

PNG = b"\x89PNG\r\n\x1a\n"  # how a PNG begins
JPEG = b"\xff\xd8\xff"  # how a JPEG begins
MAX_SCANS = 100  # scans of a JPEG; cameras and editors write up to about ten
_MAX_SCANNED = 1 << 30  # pixels of all scans of a JPEG together
_MAX_SEGMENTS = 4096  # segments of a JPEG, and bytes between them
_MAX_CHUNKS = 1024  # chunks of a PNG, beside one for each kilobyte
_PNG_PARTS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")  # chunks that describe pixels
_START_OF_SCAN = 0xDA  # JPEG's marker
_END_OF_IMAGE = 0xD9  # JPEG's marker
_TABLES = frozenset({0xC4, 0xCC, 0xDB, 0xDC, 0xDD})  # JPEG's markers of tables and numbers
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # JPEG's markers of a frame
_LONE = frozenset({0x01, *range(0xD0, 0xD9)})  # JPEG's markers without a length
_COLORS = frozenset({0xE0, 0xEE})  # JPEG's markers that say what the channels are: JFIF, Adobe
_METADATA = frozenset({*range(0xE0, 0xF0), 0xFE}) - _COLORS  # JPEG's markers of other data
_NEXT_MARKER = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")  # the end of a scan's own bytes
_BMP_METHODS = (0, 3)  # BMP's numbers of uncompressed pixels
_MAX_PPM_HEADER = 4096  # bytes
_PPM = re.compile(rb"P[56](?:\s|#[^\n]*\n)+\d+\s+\d+\s+255\s")


def keep_pixels(data: bytes) -> bytes:
    """Return an image without metadata; ValueError says what a decoder cannot read within limits."""
    if data.startswith(PNG):
        return _strip_png(data)
    if data.startswith(JPEG):
        return _strip_jpeg(data)
    if data.startswith(b"BM"):
        _check_bmp(data)
    elif data.startswith(b"P") and not _PPM.match(data, 0, _MAX_PPM_HEADER):
        # Pillow reads other kinds number by number
        raise ValueError("expected a binary PPM (P5, P6) with a short header and numbers up to 255")
    return data


def read_size(data: bytes | memoryview) -> tuple[int, int]:
    """Return the height and width that a PNG or JPEG declares; ValueError if it declares none."""
    if data[:8] == PNG and data[12:16] == b"IHDR" and len(data) >= 24:
        width, height = struct.unpack_from(">II", data, 16)
        return height, width
    at = 2
    for _ in range(_MAX_SEGMENTS if data[:3] == JPEG else 0):
        if at + 9 > len(data):
            break
        marker = data[at + 1]
        if data[at] != 0xFF or marker in (0x00, 0xFF):  # bytes between segments
            at += 1
        elif marker in _FRAMES:
            height, width = struct.unpack_from(">HH", data, at + 5)
            return height, width
        else:
            at += 2 if marker in _LONE else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    raise ValueError("truncated, or not a PNG or JPEG")


def _strip_png(data: bytes) -> bytes:
    """Return a PNG with the chunks of its pixels alone; all chunks must be whole."""
    view, at, number, parts = memoryview(data), len(PNG), 0, [memoryview(PNG)]
    kind = b""
    while kind != b"IEND":
        if at + 12 > len(data):
            raise ValueError("no end of the image")
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            raise ValueError(f"chunk {number} declares {length} bytes, but {len(data) - at - 12} follow")
        if zlib.crc32(view[at + 4 : end - 4]) != int.from_bytes(view[end - 4 : end], "big"):
            raise ValueError(f"chunk {number} has a wrong checksum")
        if kind in _PNG_PARTS:
            parts.append(view[at:end])
        number, at = number + 1, end
        if number > _MAX_CHUNKS + at // 1024:
            raise ValueError(f"more than {_MAX_CHUNKS} chunks, most of them small")
    return b"".join(parts)


def _strip_jpeg(data: bytes) -> bytes:
    """Return a JPEG with the segments of its pixels alone."""
    at, scans, pixels = 2, 0, 0
    view, parts = memoryview(data), [memoryview(data)[:2]]
    for _ in range(_MAX_SEGMENTS):
        if at + 4 > len(data) or data[at : at + 2] == bytes((0xFF, _END_OF_IMAGE)):
            return b"".join([*parts, view[at:]])
        marker = data[at + 1]
        if data[at] != 0xFF or marker in (0x00, 0xFF):  # bytes between segments
            at += 1
            continue
        if marker in _LONE:
            at += 2
            continue
        end = at + 2 + int.from_bytes(data[at + 2 : at + 4], "big")
        if marker in _FRAMES and at + 9 <= len(data):
            height, width = struct.unpack_from(">HH", data, at + 5)
            pixels = max(pixels, height * width)
        elif marker == _START_OF_SCAN:
            scans += 1
            if scans > MAX_SCANS or scans * pixels > _MAX_SCANNED:
                raise ValueError(
                    f"expected at most {MAX_SCANS} scans, and {_MAX_SCANNED} pixels in all scans together, "
                    f"got scan {scans} of {pixels} pixels"
                )
            found = _NEXT_MARKER.search(data, end)
            end = len(data) if found is None else found.start()
        elif marker not in _TABLES | _COLORS | _METADATA:
            raise ValueError(f"marker {marker:02X} is not JPEG's")
        if marker not in _METADATA:
            parts.append(view[at:end])
        at = end
    raise ValueError(f"more than {_MAX_SEGMENTS} segments")


def _check_bmp(data: bytes) -> None:
    """Refuse a compressed BMP, which Pillow decodes byte by byte."""
    header, method = int.from_bytes(data[14:18], "little"), int.from_bytes(data[30:34], "little")
    if header > 12 and method not in _BMP_METHODS:  # the shortest header has no method
        raise ValueError(f"expected a BMP without compression, got method {method}")
