"""Damaged files of every kind that strand reads, made at random of whole ones.

Mutations know the formats: most change one thing and mend the checksums, so that readers get past them to
what lies behind.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np

from lib.whole_files import (
    COLOURS,
    DEPTH,
    DESCRIPTION,
    LABELS,
    POINTS,
    POSE,
    SETTINGS,
    archive,
    deflated_tiff,
    image,
    model,
    npy,
    pcd,
    ply,
)

NUMBERS = [
    0,
    1,
    2,
    3,
    7,
    127,
    255,
    256,
    65535,
    65536,
    2**31 - 1,
    2**31,
    2**32 - 1,
    2**63 - 1,
    2**63,
    2**64 - 1,
]
WRITTEN = [
    *(str(number) for number in NUMBERS),
    *(
        "-1",
        "-0",
        "0.0",
        "1e400",
        "-1e400",
        "1e-400",
        "1e308",
        "nan",
        "inf",
        "-inf",
        "NaN",
        "Infinity",
        "null",
    ),
    *("true", "[]", "{}", '""', "''", "0x7fffffff", "0b1", "1_000", "1L", "١", "1979-05-27", "07:32:00"),
    *("9" * 30, "9" * 5000, "0x" + "f" * 9000, "1" + "0" * 400, "[" * 3000, '{"a":' * 3000, "a." * 30 + "a"),
]
WORDS = [
    *("element vertex 4", "element face 3", "property float x", "property list uchar int vertex_indices"),
    *("property uchar x", "end_header", "format ascii 1.0", "format binary_big_endian 1.0", "comment \xff"),
    *("file", "mask", "color", '"../depth.npy"', '"/dev/zero"', '"/dev/stdin"', '"loop.npy"', '"fifo.npy"'),
    *(
        '"folder.npy"',
        r'"a\u0000.npy"',
        '"' + "a" * 5000 + '.npy"',
        "[[view]]",
        "[camera]",
        "[[",
        "pose",
        "=",
    ),
    *(
        "'descr'",
        "'<u2'",
        "'|O'",
        "'<f8'",
        "'>f2'",
        "'<U9'",
        "'<c16'",
        "[('a', '<f4')]",
        "True",
        "(3,)",
        "()",
    ),
    *(
        "<M8[ns]",
        "|V8",
        "|S3",
        "<f4",
        ",",
        "'",
        '"',
        "\\",
        "\n",
        "\r\n",
        "\0",
        "\ufeff",
        "{",
        "}",
        "[",
        "]",
        "#",
    ),
    *("[tracing]", "[sensor]", 'sensor = "d435"', '"chains"', '"points"', '"curve"', '"version"', "null"),
]
DESCRIPTORS = [
    *(
        "<u2",
        ">u2",
        "|u1",
        "<i8",
        "<f2",
        "<f4",
        "<f8",
        ">f8",
        "<f16",
        "<c16",
        "|b1",
        "|O",
        "|S0",
        "<U4",
        "<U0",
    ),
    *(
        "|V0",
        "|V16",
        "<M8[ns]",
        "<m8",
        "<U999999999",
        "|S4294967296",
        "i4,i4",
        "(2,3)f4",
        "<f3",
        "<x4",
        "f",
        "",
    ),
]
SHAPES = [
    *((), (0,), (3,), (6, 8), (8, 6), (9, 3), (2, 6, 8), (48, 1), (0, 3), (3, 0), (10**6, 0), (0, 10**30)),
    *(
        (-1, 3),
        (-(2**63), 3),
        (2**32, 2**32),
        (2**63, 1),
        (1,) * 40,
        (10**12,),
        (10**6, 3),
        (True, 3),
        (2**62, 0),
    ),
]


@dataclass(frozen=True)
class Kind:
    """A kind of file: whole ones of it, as what it is read, and the mutations that know its format.

    Attributes
    ----------
    name : str
        The file's name.
    whole : tuple of bytes
    reader : str
        "scene", "model" or "config".
    view : str
        What a `scene.toml` says of a view that holds the file, if it is one of a folder.
    knowing : tuple of functions
        Of a generator of random numbers and a whole file.
    """

    name: str
    whole: tuple[bytes, ...]
    reader: str
    view: str
    knowing: tuple[Callable[[random.Random, bytes], bytes], ...]


def flipped(draw: random.Random, data: bytes) -> bytes:
    """Some bits changed."""
    out = bytearray(data)
    for _ in range(draw.choice((1, 1, 1, 2, 8, 64))):
        if out:
            out[draw.randrange(len(out))] ^= 1 << draw.randrange(8)
    return bytes(out)


def truncated(draw: random.Random, data: bytes) -> bytes:
    """Without an end, or without a start."""
    cut = draw.randrange(len(data) + 1)
    return data[:cut] if draw.random() < 0.8 else data[cut:]


def rearranged(draw: random.Random, data: bytes) -> bytes:
    """A block deleted, inserted, repeated, copied or overwritten."""
    start = draw.randrange(len(data) + 1)
    block = data[start : start + draw.choice((1, 2, 4, 16, 64, 256))]
    at, end = draw.randrange(len(data) + 1), start + len(block)
    strange = draw.choice((bytes(len(block)), b"\xff" * len(block), draw.randbytes(len(block))))
    return draw.choice(
        (
            lambda: data[:start] + data[end:],
            lambda: data[:at] + block + data[at:],
            lambda: data[:at] + strange + data[at:],
            lambda: data[:start] + strange + data[end:],
            lambda: data[:at] + block * draw.choice((2, 50, 1000)) + data[at:],
        )
    )()


def renumbered(draw: random.Random, data: bytes) -> bytes:
    """A binary number replaced."""
    width, order = draw.choice((1, 2, 4, 8)), draw.choice(("little", "big"))
    number = draw.choice(NUMBERS) % (1 << 8 * width)
    at = draw.randrange(max(len(data) - width, 0) + 1)
    return data[:at] + number.to_bytes(width, order) + data[at + width :]


def rewritten(draw: random.Random, data: bytes) -> bytes:
    """A number that is written in digits replaced, by another or by something else."""
    places = list(re.finditer(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", data))
    if not places:
        return renumbered(draw, data)
    place = draw.choice(places)
    return data[: place.start()] + draw.choice(WRITTEN).encode() + data[place.end() :]


def reworded(draw: random.Random, data: bytes) -> bytes:
    """A word replaced or inserted."""
    places = list(re.finditer(rb"[A-Za-z_]+|\"[^\"\n]*\"|'[^'\n]*'|[\[\]{}=:,\n]", data[:20000]))
    word = draw.choice(WORDS).encode()
    if not places:
        return word + data
    place = draw.choice(places)
    return data[: place.start()] + word + data[(place.end() if draw.random() < 0.6 else place.start()) :]


def reencoded(draw: random.Random, data: bytes) -> bytes:
    """Text in another encoding, or with other line ends."""
    text = data.decode("latin-1")
    return draw.choice(
        (
            lambda: text.encode("utf-16"),
            lambda: text.encode("utf-32"),
            lambda: text.encode("utf-8-sig"),
            lambda: data.replace(b"\n", b"\r\n"),
            lambda: data.replace(b"\n", b"\r"),
            lambda: data.replace(b"a", b"\xe4"),
        )
    )()


def nested(draw: random.Random, data: bytes) -> bytes:
    """Brackets in brackets where a value was."""
    places = [place.end() for place in re.finditer(rb"[=:,\[]\s*", data)]
    at, depth = draw.choice(places) if places else 0, draw.choice((10, 300, 3000, 100_000))
    opening, closing = draw.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"[[", b"]]")))
    tail = draw.choice((closing * depth, b""))
    return data[:at] + opening * depth + b"1" + tail + data[at:]


GENERAL = (flipped, truncated, rearranged, renumbered, rewritten, reworded)


def other_header(draw: random.Random, data: bytes) -> bytes:
    """An NPY file with another type, shape, order, version or length of the header."""
    end = data.find(b"\n")
    header, body = data[10:end].decode("latin-1"), data[end + 1 :]
    for _ in range(draw.choice((1, 1, 2))):
        change = draw.randrange(4)
        if change == 0:
            header = re.sub(r"'descr': [^,]*,", lambda _: f"'descr': '{draw.choice(DESCRIPTORS)}',", header)
        elif change == 1:
            header = re.sub(r"'shape': \([^)]*\)", lambda _: f"'shape': {draw.choice(SHAPES)}", header)
        elif change == 2:
            header = header.replace("False", draw.choice(("True", "None", "1", "'a'")))
        else:
            header = reworded(draw, header.encode()).decode("utf-8", "replace")
    version = draw.choice((1, 1, 1, 2, 3, 4, 0))
    encoded = header.encode("utf-8") + b"\n"
    size = struct.pack("<H" if version < 2 else "<I", len(encoded) % 65536)
    return b"\x93NUMPY" + bytes((version, 0)) + size + encoded + body


def chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """The chunks of a PNG."""
    found, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def joined(parts: list[tuple[bytes, bytes]]) -> bytes:
    """A PNG of chunks."""
    out = b"\x89PNG\r\n\x1a\n"
    for kind, data in parts:
        out += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return out


def other_chunks(draw: random.Random, data: bytes) -> bytes:
    """A PNG with other chunks, whose checksums are right."""
    parts = chunks(data)
    at = draw.randrange(len(parts))
    kind, held = parts[at]
    change = draw.randrange(6)
    if change == 0:
        header = list(struct.unpack(">IIBBBBB", parts[0][1]))
        field = draw.randrange(7)
        header[field] = draw.choice(NUMBERS) % (1 << (32 if field < 2 else 8))
        parts[0] = (b"IHDR", struct.pack(">IIBBBBB", *header))
    elif change == 1:
        del parts[at]
    elif change == 2:
        parts.insert(draw.randrange(len(parts)), parts[at])
    elif change == 3:
        parts[at] = (kind, draw.choice(GENERAL)(draw, held))
    elif change == 4:
        name = draw.choice(
            (b"tEXt", b"zTXt", b"iTXt", b"iCCP", b"acTL", b"fcTL", b"fdAT", b"PLTE", b"tRNS", b"eXIf")
        )
        long = zlib.compress(bytes(draw.choice((10, 1000, 10**5))), 1)
        parts.insert(draw.randrange(len(parts)), (name, draw.choice((b"a\0\0", b"", bytes(8))) + long))
    else:
        pixels = zlib.compress(draw.choice(GENERAL)(draw, bytes(draw.choice((0, 100, 10**5)))), 1)
        parts = [(name, pixels if name == b"IDAT" else block) for name, block in parts]
    return joined(parts)


def other_tags(draw: random.Random, data: bytes) -> bytes:
    """A TIFF with another tag, or another type, count or value of one."""
    (start,) = struct.unpack("<I", data[4:8])
    (count,) = struct.unpack("<H", data[start : start + 2])
    at = start + 2 + 12 * draw.randrange(count + 1)
    width, offset = draw.choice(((2, 0), (2, 2), (4, 4), (4, 8), (4, 8), (4, 8), (2, 8)))
    tags = (256, 257, 258, 259, 262, 273, 274, 277, 278, 279, 284, 317, 322, 323, 324, 325, 330, 339, 34665)
    numbers = tags if offset == 0 else (*NUMBERS, *range(14), 32946, start, len(data), len(data) - 8)
    number = draw.choice(numbers) % (1 << 8 * width)
    return data[: at + offset] + number.to_bytes(width, "little") + data[at + offset + width :]


def repacked(draw: random.Random, data: bytes) -> bytes:
    """A PCD file with other bytes after its header: sizes and compressed bytes, or points."""
    start = data.index(b"\n", data.index(b"DATA ")) + 1
    change = draw.choice((*GENERAL, lambda draw, body: body[:8] + flipped(draw, body[8:])))
    return data[:start] + change(draw, data[start:])


@cache
def _members(data: bytes) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(data)) as archive:
        return {f"{name}.npy": archive[name] for name in archive.files}


def other_members(draw: random.Random, data: bytes) -> bytes:
    """An archive with other members, whose checksums are right."""
    arrays = _members(data)
    members = {name: npy(array) for name, array in arrays.items()}
    name = draw.choice(list(members))
    change, method = draw.randrange(6), zipfile.ZIP_STORED
    if change == 0:
        members[name] = draw.choice((*GENERAL, other_header, other_header, other_header))(draw, members[name])
    elif change == 1:
        members[draw.choice((*members, "mask.npy", "truth_x.npy", "../a.npy"))] = members.pop(name)
    elif change == 2:
        members[draw.choice(("left.npy", name))] = bytes(draw.choice((10, 1000, 10**6)))
        method = zipfile.ZIP_DEFLATED
    elif change == 3:
        method = draw.choice((zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA, zipfile.ZIP_DEFLATED))
    elif change == 4:
        array = arrays[name]
        kinds = ("f2", "f4", "f8", "c8", "i2", "u2", "u8", "?", "S3", "U3")
        members[name] = npy(
            array.astype(draw.choice(kinds), copy=False) if array.dtype.kind != "U" else array[None]
        )
    else:
        array = np.array(arrays[name])
        if array.size and array.dtype.kind in "fiu":
            array.flat[draw.randrange(array.size)] = draw.choice(
                (0, 1, 127) if array.dtype.kind != "f" else (np.nan, np.inf, -1, 1e308, -1e-320, 0)
            )
        members[name] = npy(array)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, held in members.items():
            archive.writestr(name, held)
    return draw.choice((*GENERAL, *[lambda _, whole: whole] * 12))(draw, out.getvalue())


def other_values(draw: random.Random, data: bytes) -> bytes:
    """A JSON file with another value somewhere, or without a key."""
    content = json.loads(data)
    inside = content
    while True:
        keys = list(inside) if isinstance(inside, dict) else range(len(inside))
        if not keys:
            return data
        key = draw.choice(keys)
        if isinstance(inside[key], (dict, list)) and inside[key] and draw.random() < 0.8:
            inside = inside[key]
            continue
        break
    strange = [
        None,
        True,
        -1,
        0,
        1.5,
        1e308,
        10**30,
        10**400,
        "",
        "tubes",
        "NaN",
        [],
        {},
        [1],
        [[]],
        {"a": 1},
        [None],
    ]
    if draw.random() < 0.2:
        del inside[key]
    elif isinstance(inside, dict) and draw.random() < 0.1:
        inside[draw.choice(("", "points", "version", "a"))] = inside[key]
    else:
        inside[key] = draw.choice(strange)
    return json.dumps(content).encode()


def kinds() -> tuple[Kind, ...]:
    """Every kind of file that strand reads."""
    extras = {
        "box": np.array([[-1.0, -2, -3], [1, 2, 3]]),
        "radius": np.float64(0.004),
        "name": np.array("knot"),
        "truth_0": POINTS.astype(np.float32),
        "mask": np.stack([LABELS, LABELS]),
        "color": np.stack([COLOURS, COLOURS]),
    }
    faces = "property uchar red\nelement face 1\nproperty list uchar int vertex_indices\n"
    colourful = b"".join(row.tobytes() + b"\7" for row in POINTS.astype("<f8"))
    whole_ply = ply("binary_little_endian", "double", faces)
    with_faces = (
        whole_ply[: whole_ply.index(b"end_header\n") + 11] + colourful + b"\3" + struct.pack("<3i", 0, 1, 2)
    )
    plys = (
        ply("ascii", "float"),
        ply("binary_little_endian", "float"),
        ply("binary_big_endian", "double"),
        with_faces,
    )
    shades = np.arange(POINTS.size, dtype=np.uint8).reshape(POINTS.shape)
    pcds = (
        pcd("ascii", POINTS, shades, "F"),
        pcd("binary", POINTS.astype(np.float32), shades, padded=True),
        pcd("binary_compressed", np.repeat(POINTS, 3, axis=0), np.repeat(shades, 3, axis=0)),
    )
    texts = tuple(
        head + b"\n".join(separator.join(str(x).encode() for x in row) for row in rows)
        for head, separator, rows in (
            (b"", b" ", POINTS.tolist()),
            (b"x,y,z,r,g,b\n", b",", np.hstack([POINTS, shades]).tolist()),
            (b"# made\n", b";", np.hstack([POINTS, shades / 255]).tolist()),
        )
    )
    tiffs = (image(DEPTH, "TIFF"), image((DEPTH * 0.001).astype(np.float32), "TIFF"), deflated_tiff(DEPTH))
    depth = f'file = "depth.png"\n{POSE}'
    text = (nested, reencoded)
    masks = (image(LABELS), image(LABELS.astype(np.uint16)), image(LABELS > 0))
    return (
        Kind(
            "scene.npz",
            (archive(np.savez), archive(np.savez_compressed, **extras)),
            "scene",
            "",
            (other_members,) * 5,
        ),
        Kind("scene.toml", (DESCRIPTION.encode(),), "scene", "", text),
        Kind("config.toml", (SETTINGS.encode(), b'sensor = "d435"\n'), "config", "", text),
        Kind("model.json", (model(),), "model", "", (*text, *(other_values,) * 6)),
        Kind("a.png", (image(DEPTH),), "scene", f'file = "a.png"\n{POSE}', (other_chunks,) * 4),
        Kind("m.png", masks, "scene", f'{depth}mask = "m.png"\n', (other_chunks,) * 4),
        Kind(
            "m.npy", (npy(LABELS), npy(LABELS > 0)), "scene", f'{depth}mask = "m.npy"\n', (other_header,) * 4
        ),
        Kind("c.png", (image(COLOURS),), "scene", f'{depth}color = "c.png"\n', (other_chunks,) * 4),
        Kind(
            "c.jpg",
            (image(COLOURS, "JPEG"), image(COLOURS, "BMP"), image(COLOURS, "PPM")),
            "scene",
            f'{depth}color = "c.jpg"\n',
            (),
        ),
        Kind(
            "a.npy",
            (npy(DEPTH), npy(DEPTH * 0.001), npy(POINTS)),
            "scene",
            f'file = "a.npy"\n{POSE}',
            (other_header,) * 4,
        ),
        Kind("a.ply", plys, "scene", f'file = "a.ply"\n{POSE}', (rewritten, reworded, reencoded)),
        Kind("a.pcd", pcds, "scene", f'file = "a.pcd"\n{POSE}', (rewritten, reworded, reencoded, repacked)),
        Kind("a.xyz", texts, "scene", f'file = "a.xyz"\n{POSE}', (rewritten, reworded, reencoded)),
        Kind("a.tiff", tiffs, "scene", f'file = "a.tiff"\n{POSE}', (other_tags,) * 4),
    )


def numbered(
    seed: int, number: int, chosen: tuple[Kind, ...], others: tuple[Kind, ...]
) -> tuple[Kind, bytes]:
    """The damaged file of a seed and a number, of one of some kinds, and its kind."""
    draw = random.Random(f"{seed} {number}")
    kind = draw.choice(chosen)
    return kind, mutated(draw, kind, others)


def mutated(draw: random.Random, kind: Kind, others: tuple[Kind, ...]) -> bytes:
    """A damaged file of a kind: one to three mutations, or the start of one file and the end of another."""
    data = draw.choice(kind.whole)
    if draw.random() < 0.03:
        other = draw.choice(draw.choice((kind, *others)).whole)
        return data[: draw.randrange(len(data) + 1)] + other[draw.randrange(len(other) + 1) :]
    first, *rest = draw.choices((*GENERAL, *kind.knowing), k=draw.choice((1, 1, 1, 2, 3)))
    data = first(draw, data)
    for again in rest:  # what knows a format needs whole files
        data = (again if again in (*GENERAL, nested, reencoded) else draw.choice(GENERAL))(draw, data)
    return data
