"""LZF, the compression of PCD files: runs of bytes, and copies of what came before them."""

from __future__ import annotations

# a copy of 264 bytes takes three
MOST_GROWTH = 88


def decompress(data: memoryview, size: int) -> bytearray:
    """Return the bytes that LZF compressed, which must be so many.

    Parameters
    ----------
    data : memoryview of bytes
        What was compressed.
    size : int
        How many bytes it becomes.

    Raises
    ------
    ValueError
        If it becomes more or fewer, ends too early, or copies what is not there.
    """
    if size > MOST_GROWTH * len(data):
        raise ValueError(f"{len(data)} compressed bytes never become {size}")
    out = bytearray()
    at, end = 0, len(data)
    while at < end:
        control = data[at]
        at += 1
        if control < 32:  # so many bytes and one more, as they are
            length = control + 1
            if at + length > end:
                raise ValueError("the compressed bytes end too early")
            out += data[at : at + length]
            at += length
        else:  # a copy: three bits say its length, with a byte more if all are set; thirteen its distance
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
            if len(piece) < length:  # it runs into itself, and so repeats
                piece = (piece * (length // len(piece) + 1))[:length]
            out += piece
        if len(out) > size:
            raise ValueError(f"expected {size} bytes when decompressed, got more")
    if len(out) < size:
        raise ValueError(f"expected {size} bytes when decompressed, got {len(out)}")
    return out
