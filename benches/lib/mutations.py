"""Mutations of files: most change one thing and set right checksums, so that readers get past them.

Each function takes a generator of random numbers and a file, and returns a damaged file.
"""

from __future__ import annotations

import io
import json
import random
import re
import struct
import zipfile
import zlib
from functools import cache

import numpy as np

from lib.odd_values import DESCRIPTORS, NUMBERS, SHAPES, WORDS, WRITTEN
from lib.whole_files import make_npy


def flipped(draw: random.Random, data: bytes) -> bytes:
    """Change some bits."""
    out = bytearray(data)
    for _ in range(draw.choice((1, 1, 1, 2, 8, 64))):
        if out:
            out[draw.randrange(len(out))] ^= 1 << draw.randrange(8)
    return bytes(out)


def truncated(draw: random.Random, data: bytes) -> bytes:
    """Cut off the end or the start."""
    cut = draw.randrange(len(data) + 1)
    return data[:cut] if draw.random() < 0.8 else data[cut:]


def rearranged(draw: random.Random, data: bytes) -> bytes:
    """Delete, insert, repeat, copy or overwrite a block."""
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
    """Replace a binary number."""
    width, order = draw.choice((1, 2, 4, 8)), draw.choice(("little", "big"))
    number = draw.choice(NUMBERS) % (1 << 8 * width)
    at = draw.randrange(max(len(data) - width, 0) + 1)
    return data[:at] + number.to_bytes(width, order) + data[at + width :]


def rewritten(draw: random.Random, data: bytes) -> bytes:
    """Replace a number in digits by another number or by something else."""
    places = list(re.finditer(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?", data))
    if not places:
        return renumbered(draw, data)
    place = draw.choice(places)
    return data[: place.start()] + draw.choice(WRITTEN).encode() + data[place.end() :]


def reworded(draw: random.Random, data: bytes) -> bytes:
    """Replace or insert a word."""
    places = list(re.finditer(rb"[A-Za-z_]+|\"[^\"\n]*\"|'[^'\n]*'|[\[\]{}=:,\n]", data[:20000]))
    word = draw.choice(WORDS).encode()
    if not places:
        return word + data
    place = draw.choice(places)
    return data[: place.start()] + word + data[(place.end() if draw.random() < 0.6 else place.start()) :]


def reencoded(draw: random.Random, data: bytes) -> bytes:
    """Change the encoding or the line ends of text."""
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
    """Put nested brackets where a value was."""
    places = [place.end() for place in re.finditer(rb"[=:,\[]\s*", data)]
    at, depth = draw.choice(places) if places else 0, draw.choice((10, 300, 3000, 100_000))
    opening, closing = draw.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"{a=", b"}"), (b"[[", b"]]")))
    tail = draw.choice((closing * depth, b""))
    return data[:at] + opening * depth + b"1" + tail + data[at:]


GENERAL = (flipped, truncated, rearranged, renumbered, rewritten, reworded)


def change_header(draw: random.Random, data: bytes) -> bytes:
    """Change the type, shape, order, version or header's length of an NPY file."""
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


def split_chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    """Return the chunks of a PNG: names and contents."""
    found, at = [], 8
    while at + 12 <= len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + length]))
        at += 12 + length
    return found


def join_chunks(parts: list[tuple[bytes, bytes]]) -> bytes:
    """Return a PNG made of chunks, with right checksums."""
    out = b"\x89PNG\r\n\x1a\n"
    for kind, data in parts:
        out += struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return out


def change_chunks(draw: random.Random, data: bytes) -> bytes:
    """Change the chunks of a PNG, and set right checksums."""
    parts = split_chunks(data)
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
    return join_chunks(parts)


def change_tags(draw: random.Random, data: bytes) -> bytes:
    """Change a tag of a TIFF, or its type, count or value."""
    (start,) = struct.unpack("<I", data[4:8])
    (count,) = struct.unpack("<H", data[start : start + 2])
    at = start + 2 + 12 * draw.randrange(count + 1)
    width, offset = draw.choice(((2, 0), (2, 2), (4, 4), (4, 8), (4, 8), (4, 8), (2, 8)))
    tags = (256, 257, 258, 259, 262, 273, 274, 277, 278, 279, 284, 317, 322, 323, 324, 325, 330, 339, 34665)
    numbers = tags if offset == 0 else (*NUMBERS, *range(14), 32946, start, len(data), len(data) - 8)
    number = draw.choice(numbers) % (1 << 8 * width)
    return data[: at + offset] + number.to_bytes(width, "little") + data[at + offset + width :]


def change_body(draw: random.Random, data: bytes) -> bytes:
    """Change the bytes after the header of a PCD file: sizes and compressed bytes, or points."""
    start = data.index(b"\n", data.index(b"DATA ")) + 1
    change = draw.choice((*GENERAL, lambda draw, body: body[:8] + flipped(draw, body[8:])))
    return data[:start] + change(draw, data[start:])


@cache
def load_members(data: bytes) -> dict[str, np.ndarray]:
    """Return the arrays of an archive by the names of its members."""
    with np.load(io.BytesIO(data)) as archive:
        return {f"{name}.npy": archive[name] for name in archive.files}


def change_members(draw: random.Random, data: bytes) -> bytes:
    """Change the members of an archive, and set right checksums."""
    arrays = load_members(data)
    members = {name: make_npy(array) for name, array in arrays.items()}
    name = draw.choice(list(members))
    change, method = draw.randrange(6), zipfile.ZIP_STORED
    if change == 0:
        members[name] = draw.choice((*GENERAL, change_header, change_header, change_header))(
            draw, members[name]
        )
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
        members[name] = make_npy(
            array.astype(draw.choice(kinds), copy=False) if array.dtype.kind != "U" else array[None]
        )
    else:
        array = np.array(arrays[name])
        if array.size and array.dtype.kind in "fiu":
            array.flat[draw.randrange(array.size)] = draw.choice(
                (0, 1, 127) if array.dtype.kind != "f" else (np.nan, np.inf, -1, 1e308, -1e-320, 0)
            )
        members[name] = make_npy(array)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, held in members.items():
            archive.writestr(name, held)
    return draw.choice((*GENERAL, *[lambda _, whole: whole] * 12))(draw, out.getvalue())


def change_values(draw: random.Random, data: bytes) -> bytes:
    """Replace a value of a JSON file, or delete a key."""
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
    # fmt: off
    strange = [
        None, True, -1, 0, 1.5, 1e308, 10**30, 10**400, "", "tubes", "NaN", [], {}, [1], [[]], {"a": 1},
        [None],
    ]
    # fmt: on
    if draw.random() < 0.2:
        del inside[key]
    elif isinstance(inside, dict) and draw.random() < 0.1:
        inside[draw.choice(("", "points", "version", "a"))] = inside[key]
    else:
        inside[key] = draw.choice(strange)
    return json.dumps(content).encode()
