"""Tricks with MCAP files: chunks, indexes and records that declare much, or hold much in few bytes."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import strand
from shared.tricks import MAX_BYTES, Trick
from shared.tricks.mcap_parts import (
    COMPRESSED,
    IMAGE,
    MAGIC,
    START,
    TF,
    compress,
    compress_zeros,
    make_channel,
    make_chunk,
    make_file,
    make_index,
    make_message,
    make_schema,
    make_statistics,
    make_topics,
    pack_image,
    pack_record,
    pack_text,
)
from strand.io.recordings.recording_contents import read_recording_contents
from strand.support.files import FileFormatError

SECONDS = 5.0  # processor time of a trick; strand promises 2 on a machine of its own
DEPTH = pack_image(8, 6, struct.pack("<48H", *[500] * 48))
TOPICS = make_topics({"/depth": IMAGE})
FRAME = TOPICS + make_message(1, START, DEPTH)
_FIRST = len(MAGIC) + len(pack_record(1, pack_text("ros2") + pack_text("")))  # place of the first record
_NEAR = 15 << 20  # bytes of a chunk that just fits


def list_tricks() -> list[Trick]:
    """Return the tricks with MCAP files."""
    zeros = FRAME + pack_record(128, bytes(_NEAR))
    refused: dict[str, Callable[[], bytes]] = {
        "zstd of 2 GiB": lambda: make_file(make_chunk(b"", size=1 << 31, packed=compress_zeros(1 << 31))),
        "zstd of 60 MiB that declares as much": lambda: make_file(
            make_chunk(b"", size=60 << 20, packed=compress_zeros(60 << 20))
        ),
        "zstd of 2 GiB that declares little": lambda: make_file(
            make_chunk(b"", size=1000, packed=compress_zeros(1 << 31))
        ),
        "zstd that declares more than it has": lambda: make_file(make_chunk(FRAME, size=_NEAR)),
        "zstd of a large window": lambda: make_file(
            make_chunk(b"", size=_NEAR, packed=compress_zeros(128 << 20, 27))
        ),
        "zstd of empty frames": lambda: make_file(make_chunk(b"", packed=compress("zstd", b"") * 500_000)),
        "lz4 of 256 MiB": lambda: make_file(make_chunk(bytes(1 << 28), "lz4")),
        "lz4 of 256 MiB that declares little": lambda: make_file(make_chunk(bytes(1 << 28), "lz4", 1000)),
        "no compression that declares much": lambda: make_file(make_chunk(FRAME, "", 1 << 62)),
        "zstd in many chunks": lambda: make_file(FRAME, *([make_chunk(zeros)] * 500)),
        "a chunk in a chunk": lambda: make_file(make_chunk(make_chunk(zeros))),
        "records of nothing": lambda: make_file(make_chunk(pack_record(128, b"") * 1_700_000)),
        "messages of nothing": lambda: make_file(make_chunk(TOPICS + make_message(1, START, b"") * 500_000)),
        "a message of much": lambda: make_file(TOPICS, make_message(1, START, bytes(20 << 20))),
        "a message that declares much": lambda: make_file(TOPICS, pack_record(5, DEPTH, 1 << 62)),
        "many channels": lambda: make_file(
            make_chunk(
                make_schema(1, IMAGE) + b"".join(make_channel(i, 1, f"/{i:030}") for i in range(65_536))
            )
        ),
        "a long topic": lambda: make_file(
            make_chunk(make_schema(1, IMAGE) + make_channel(1, 1, b"a" * _NEAR))
        ),
        "a long type": lambda: make_file(make_schema(1, b"a" * (20 << 20)), make_channel(1, 1, "/a")),
        "a cut chunk": lambda: make_file(FRAME, pack_record(6, make_chunk(zeros)[9:200], 1 << 40)),
        "an index of 2 GiB": lambda: _index(
            make_chunk(b"", size=1 << 31, packed=compress_zeros(1 << 31)), 1 << 31
        ),
        "an index that lies": lambda: _index(
            make_chunk(b"", size=1 << 31, packed=compress_zeros(1 << 31)), 1000
        ),
        "an index of one place": lambda: _index(make_chunk(zeros), len(zeros), 2000),
        "an index of many places": lambda: _index(make_chunk(FRAME), len(FRAME), 60_000),
        "an index of many channels": lambda: _index(make_chunk(FRAME), len(FRAME), 100, 65_536),
        "an index of overlapping chunks": _overlap,
        "many chunks at one time": lambda: make_file(
            TOPICS, *[make_chunk(make_message(1, START, DEPTH))] * 9000
        ),
        "an index of many messages": lambda: _index(make_chunk(FRAME), len(FRAME), counts={1: 1 << 62}),
    }
    answered: dict[str, Callable[[], bytes]] = {
        "a chunk that just fits": lambda: make_file(make_chunk(zeros)),
        "many image topics": lambda: _list_images({f"/camera_{i}/image": IMAGE for i in range(1000)}),
        "many topics of TF": lambda: _list_images({f"/tf_{i}/tf_static": TF for i in range(1000)}),
        "many chunks of one message": lambda: make_file(
            TOPICS,
            *(
                make_chunk(make_message(1, START + i, DEPTH), span=(START + i, START + i))
                for i in range(3000)
            ),
        ),
    }
    return [
        *(
            try_recording(f"mcap of {name}", "a.mcap", make, intrinsics=np.eye(3))
            for name, make in refused.items()
        ),
        *(
            try_recording(f"mcap of {name}", "a.mcap", make, True, intrinsics=np.eye(3))
            for name, make in answered.items()
        ),
    ]


def try_recording(
    name: str, file: str, make: Callable[[], bytes], answered: bool = False, **options: Any
) -> Trick:
    """Return a trick with a recording, of which all frames and a description are read."""
    return Trick(
        name,
        lambda folder: (folder / file).write_bytes(make()),
        lambda folder: read_frames(folder / file, **options),
        answered,
        SECONDS,
    )


def read_frames(path: Path, **options: Any) -> None:
    """Describe a recording, and read all frames."""
    with contextlib.suppress(FileFormatError, ValueError):
        read_recording_contents(path, None, MAX_BYTES)
    with strand.Recording(path, max_bytes=MAX_BYTES, **options) as recording:
        for frame in recording:
            assert frame.views


def _index(
    chunk: bytes, size: int, times: int = 1, channels: int = 2, counts: dict[int, int] | None = None
) -> bytes:
    """Return a file of a chunk with an index that leads to it several times."""
    place = make_index(_FIRST, len(chunk), size, range(channels))
    return make_file(chunk, index=[TOPICS, *[place] * times, make_statistics(counts or {1: 1}, times)])


def _overlap() -> bytes:
    chunk = make_chunk(FRAME + pack_record(128, bytes(8 << 20)))
    size = len(FRAME) + 9 + (8 << 20)
    places = [make_index(_FIRST + i * len(chunk), len(chunk), size) for i in range(20)]
    return make_file(*[chunk] * 20, index=[TOPICS, *places, make_statistics({1: 20}, 20)])


def _list_images(more: dict[str, str]) -> bytes:
    """Return a file of one depth topic and of a message on each of many other topics."""
    topics = {"/depth": IMAGE, "/color": COMPRESSED} | more
    color = pack_image(8, 6, bytes(144), "rgb8")
    messages = [
        make_message(i + 1, START + i, DEPTH if i == 0 else color if kind == IMAGE else bytes(8))
        for i, kind in enumerate(topics.values())
        if kind != COMPRESSED
    ]
    return make_file(make_chunk(make_topics(topics) + b"".join(messages)))
