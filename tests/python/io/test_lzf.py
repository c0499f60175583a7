"""Tests of the decompression of LZF."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lib.whole_files import compress_lzf
from strand.io.lzf import decompress


@given(st.lists(st.tuples(st.binary(min_size=1, max_size=40), st.integers(1, 300)), max_size=20))
def test_decompression_inverts_compression(parts):
    data = b"".join(part * repeats for part, repeats in parts)
    packed = compress_lzf(data)
    assert decompress(memoryview(packed), len(data)) == data


def test_overlapping_copies_repeat():
    assert decompress(memoryview(b"\x01ab\xe0\x00\x01"), 11) == b"abababababa"
    assert len(compress_lzf(bytes(100_000))) < 1200


@pytest.mark.parametrize(
    ("packed", "size", "reason"),
    [
        (b"\x05abc", 6, "end too early"),
        (b"\x00a\x20", 4, "end too early"),
        (b"\x00a\xe0\x00", 10, "end too early"),
        (b"\x00a\x20\x01", 4, "starts before the first byte"),
        (b"\x02abc", 2, "expected 2 bytes when decompressed, got more"),
        (b"\x02abc", 4, "expected 4 bytes when decompressed, got 3"),
        (b"\x02abc", 10**9, "4 compressed bytes cannot expand to 1000000000"),
    ],
)
def test_damage_is_named(packed, size, reason):
    with pytest.raises(ValueError, match=reason):
        decompress(memoryview(packed), size)


def test_random_bytes_end():
    draw = np.random.default_rng(0)
    for _ in range(300):
        packed = draw.bytes(draw.integers(1, 60))
        try:
            assert len(decompress(memoryview(packed), 100)) == 100
        except ValueError:
            continue
