"""Decompress LZF, which PCD files use: runs of literal bytes, and copies of earlier output."""

from __future__ import annotations

MAX_GROWTH = 88  # output bytes per input byte: three bytes can copy 264


def decompress(data: memoryview, size: int) -> bytearray:
    """Return the `size` bytes that LZF compressed; raise ValueError if the data is damaged."""
    if size > MAX_GROWTH * len(data):
        raise ValueError(f"{len(data)} compressed bytes cannot expand to {size}")
    out = bytearray()
    at, end = 0, len(data)
    while at < end:
        control = data[at]
        at += 1
        if control < 32:  # control + 1 literal bytes
            length = control + 1
            if at + length > end:
                raise ValueError("the compressed bytes end too early")
            out += data[at : at + length]
            at += length
        else:  # a copy: 3 bits of length (and one more byte if all are set), 13 bits of distance
            length = (control >> 5) + 2
            if at + (2 if length == 9 else 1) > end:
                raise ValueError("the compressed bytes end too early")
            if length == 9:
                length += data[at]
                at += 1
            start = len(out) - ((control & 31) << 8) - data[at] - 1
            at += 1
            if start < 0:
                raise ValueError("a copy starts before the first byte")
            piece = out[start : start + length]
            if len(piece) < length:  # the copy overlaps its own output, which repeats
                piece = (piece * (length // len(piece) + 1))[:length]
            out += piece
        if len(out) > size:
            raise ValueError(f"expected {size} bytes when decompressed, got more")
    if len(out) < size:
        raise ValueError(f"expected {size} bytes when decompressed, got {len(out)}")
    return out
