"""Tricks with messages of recordings: sizes, counts and texts that declare much, and messages that wait."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np

from shared.tricks import MAX_BYTES, Trick
from shared.tricks.images import SIDE, make_jpeg, make_png, repeat_scans
from shared.tricks.mcap_files import DEPTH, SECONDS, read_frames, try_recording
from shared.tricks.mcap_parts import (
    CLOUD,
    COMPRESSED,
    IMAGE,
    INFO,
    START,
    TF,
    make_chunk,
    make_file,
    make_message,
    make_topics,
    pack_compressed,
    pack_image,
    pack_info,
    pack_points,
    pack_transforms,
)
from strand import Recording

K = {"intrinsics": np.eye(3)}
_CODEC = struct.pack("<iff", 0, 0.0, 0.0)  # before the PNG of compressed depth
_LINKS = 64  # transforms from the world to a camera
_FRAMES = 5000  # images of that camera
_WAITING = 200  # messages of 1 MB that wait for one message of another topic


def list_tricks() -> list[Trick]:
    """Return the tricks with messages."""
    huge = (1 << 32) - 1
    found = [
        _try("an image of huge sides", lambda: {IMAGE: pack_image(huge, huge, bytes(96), step=huge)}, **K),
        _try("an image of a long row", lambda: {IMAGE: pack_image(3_000_000, 1, bytes(6_000_000))}, **K),
        _try("an image that just fits", lambda: {IMAGE: pack_image(600, 600, bytes(720_000))}, True, **K),
        _try(
            "an image of another CameraInfo",
            lambda: {INFO: pack_info(8, 6), IMAGE: pack_image(640, 480, bytes(614_400))},
        ),
        _try(
            "an image of a long frame",
            lambda: {IMAGE: pack_image(8, 6, bytes(96), frame=b"a" * (7 << 20))},
            **K,
        ),
        _try(
            "an image of a wide frame",
            lambda: {IMAGE: pack_image(8, 6, bytes(96), frame=_widen(7 << 20))},
            **K,
        ),
        _try(
            "an image of a long encoding", lambda: {IMAGE: pack_image(8, 6, bytes(96), "a" * (7 << 20))}, **K
        ),
        _try(
            "a png of another CameraInfo",
            lambda: {INFO: pack_info(8, 6), COMPRESSED: _compress(_paint_black())},
        ),
        _try(
            "a png without a CameraInfo's size",
            lambda: {INFO: pack_info(0, 0), COMPRESSED: _compress(_paint_black())},
        ),
        _try(
            "a png of the CameraInfo's size",
            lambda: {INFO: pack_info(SIDE, SIDE), COMPRESSED: _compress(_paint_black())},
        ),
        _try(
            "a png of floats",
            lambda: {COMPRESSED: _compress(_CODEC + make_png(1000, 700, 16, 0), "32FC1")},
            **K,
        ),
        _try("a long format", lambda: {COMPRESSED: pack_compressed("16UC1; " + "a" * (7 << 20), b"")}, **K),
        _try("a lens of many numbers", lambda: {INFO: pack_info(8, 6, 950_000), IMAGE: DEPTH}),
        _try("points of many fields", lambda: {CLOUD: pack_points(1, 1, bytes(12), 375_000)}),
        _try("many points", lambda: {CLOUD: pack_points(650_000, 1, bytes(7_800_000))}),
        _try("points of huge sides", lambda: {CLOUD: pack_points(huge, 1 << 20, bytes(120))}),
        _try("points that just fit", lambda: {CLOUD: pack_points(60_000, 1, bytes(720_000))}, True),
        _try("many transforms", lambda: {TF: _list_transforms(70_000), IMAGE: DEPTH}, world="world", **K),
        _try(
            "transforms that are not there",
            lambda: {TF: pack_transforms([], count=huge), IMAGE: DEPTH},
            world="w",
            **K,
        ),
        _try(
            "a jpeg of large pixels",
            lambda: {INFO: pack_info(8, 6), IMAGE: DEPTH, COMPRESSED: _color(make_jpeg(SIDE, SIDE))},
            True,
        ),
        _try(
            "a jpeg of many scans",
            lambda: {
                IMAGE: DEPTH,
                COMPRESSED: _color(repeat_scans(make_jpeg(8, 6, progressive=True), 20_000)),
            },
            **K,
        ),
        Trick(
            "recording of depth that waits for colours",
            lambda folder: _write(folder, _list_waiting(False)),
            lambda folder: _read_undecoded(folder, _WAITING),
            True,
            SECONDS,
        ),
        Trick(
            "recording of messages that fill their chunks",
            lambda folder: _write(folder, _list_filling()),
            lambda folder: _read_undecoded(folder, 2),
            seconds=SECONDS,
        ),
        *(
            try_recording(
                f"recording of {name} below a chain of TF",
                "a.mcap",
                partial(_hang, leaves),
                True,
                world="w",
                **K,
            )
            for name, leaves in {"tiny images": 1, "images of other frames": _FRAMES}.items()
        ),
        Trick(
            "recording of cameras far apart",
            lambda folder: _write(folder, _list_waiting(True)),
            lambda folder: read_frames(
                folder / "a.mcap", topics=["/0/image", "/1/image"], poses=[np.eye(4)] * 2, tolerance=10.0, **K
            ),
            seconds=SECONDS,
        ),
    ]
    return found


def _try(
    name: str, messages: Callable[[], dict[str, bytes]], answered: bool = False, **options: object
) -> Trick:
    """Return a trick with a recording of one message on a topic of each type."""
    return try_recording(f"recording of {name}", "a.mcap", lambda: _make(messages()), answered, **options)


def _make(messages: dict[str, bytes]) -> bytes:
    names = {INFO: "/camera_info", TF: "/tf_static"}
    topics = {names.get(kind, f"/{kind.rpartition('/')[2]}"): kind for kind in messages}
    records = [make_message(i + 1, START + i, data) for i, data in enumerate(messages.values())]
    return make_file(
        make_chunk(make_topics(topics)), *(make_chunk(one, span=(START, START + 99)) for one in records)
    )


def _widen(size: int) -> bytes:
    """Return a text of which each letter takes four bytes in memory, but one in the file."""
    return b"a" * size + "\U0001f600".encode()


def _paint_black() -> bytes:
    return _CODEC + make_png(SIDE, SIDE, 16, 0)


def _compress(data: bytes, kind: str = "16UC1") -> bytes:
    return pack_compressed(f"{kind}; compressedDepth png", data)


def _color(data: bytes) -> bytes:
    return pack_compressed("rgb8; jpeg compressed bgr8", data)


def _list_transforms(count: int) -> bytes:
    return pack_transforms([("world", f"{i:06}") for i in range(count)])


def _list_waiting(apart: bool) -> bytes:
    """Return a file of many depth images at nearly one time, and of one image of another topic at its end."""
    data = pack_image(8, 6, bytes(1 << 20))
    topics = make_topics({"/0/image": IMAGE, "/1/image": IMAGE})
    other = DEPTH if apart else pack_image(8, 6, bytes(144), "rgb8")
    chunks = [
        make_chunk(make_message(1, START + i, data), span=(START + i, START + i)) for i in range(_WAITING)
    ]
    last = START + _WAITING
    return make_file(
        make_chunk(topics, span=(START, START)),
        *chunks,
        make_chunk(make_message(2, last, other), span=(last, last)),
    )


def _list_filling() -> bytes:
    """Return a file of two chunks, which each are one message that nearly takes the limit."""
    data = pack_image(8, 6, bytes(15 << 20))
    chunks = [make_chunk(make_message(1, START + i, data), span=(START + i, START + i)) for i in range(2)]
    return make_file(make_chunk(make_topics({"/0/image": IMAGE})), *chunks)


def _hang(leaves: int) -> bytes:
    """Return a file of tiny images, in turn from some frames of TF, below a chain of moving frames."""
    names = ["w", *(f"link{i}" for i in range(_LINKS - 1))]
    pairs = [*pairwise(names), *((names[-1], f"camera{i}") for i in range(leaves))]
    data = struct.pack("<48H", *[500] * 48)
    last = START + 10**9
    messages = [
        make_message(1, START, pack_transforms(pairs, START)),
        *(
            make_message(2, START + i, pack_image(8, 6, data, frame=f"camera{i % leaves}", stamp=START + i))
            for i in range(_FRAMES)
        ),
        make_message(1, last, pack_transforms(pairs, last)),
    ]
    return make_file(make_chunk(make_topics({"/tf": TF, "/image": IMAGE}) + b"".join(messages)))


def _write(folder: Path, data: bytes) -> None:
    (folder / "a.mcap").write_bytes(data)


def _read_undecoded(folder: Path, messages: int) -> None:
    with Recording(folder / "a.mcap", max_bytes=MAX_BYTES, **K) as recording:
        assert sum(1 for _ in recording.read_undecoded()) == messages
