"""Numbers, words and types that damaged files hold: limits of integers, foreign keywords, mad shapes."""

from __future__ import annotations

# fmt: off
NUMBERS = [
    0, 1, 2, 3, 7, 127, 255, 256, 65535, 65536,
    2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1,
]  # unsigned whole numbers in binary files

WRITTEN = [
    *(str(number) for number in NUMBERS),
    "-1", "-0", "0.0", "1e400", "-1e400", "1e-400", "1e308", "nan", "inf", "-inf", "NaN", "Infinity", "null",
    "true", "[]", "{}", '""', "''", "0x7fffffff", "0b1", "1_000", "1L", "١", "1979-05-27", "07:32:00",
    "9" * 30, "9" * 5000, "0x" + "f" * 9000, "1" + "0" * 400, "[" * 3000, '{"a":' * 3000, "a." * 30 + "a",
]  # in place of numbers in text

WORDS = [
    "element vertex 4", "element face 3", "property float x", "property list uchar int vertex_indices",
    "property uchar x", "end_header", "format ascii 1.0", "format binary_big_endian 1.0", "comment \xff",
    "file", "mask", "color", '"../depth.npy"', '"/dev/zero"', '"/dev/stdin"', '"loop.npy"', '"fifo.npy"',
    '"folder.npy"', r'"a\u0000.npy"', '"' + "a" * 5000 + '.npy"', "[[view]]", "[camera]", "[[", "pose", "=",
    "'descr'", "'<u2'", "'|O'", "'<f8'", "'>f2'", "'<U9'", "'<c16'", "[('a', '<f4')]", "True", "(3,)", "()",
    "<M8[ns]", "|V8", "|S3", "<f4",
    ",", "'", '"', "\\", "\n", "\r\n", "\0", "\ufeff", "{", "}", "[", "]", "#",
    "[tracing]", "[sensor]", 'sensor = "d435"', '"chains"', '"points"', '"curve"', '"version"', "null",
]  # in place of words in text

DESCRIPTORS = [
    "<u2", ">u2", "|u1", "<i8", "<f2", "<f4", "<f8", ">f8", "<f16", "<c16", "|b1", "|O", "|S0", "<U4", "<U0",
    "|V0", "|V16", "<M8[ns]", "<m8", "<U999999999", "|S4294967296", "i4,i4", "(2,3)f4", "<f3", "<x4", "f", "",
]  # types in headers of NPY files

SHAPES = [
    (), (0,), (3,), (6, 8), (8, 6), (9, 3), (2, 6, 8), (48, 1), (0, 3), (3, 0), (10**6, 0), (0, 10**30),
    (-1, 3), (-(2**63), 3), (2**32, 2**32), (2**63, 1), (1,) * 40, (10**12,), (10**6, 3), (True, 3),
    (2**62, 0),
]  # in headers of NPY files
# fmt: on
