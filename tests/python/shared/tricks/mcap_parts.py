"""Records of MCAP files and messages in CDR, which may lie about their sizes."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterable, Sequence
from typing import Any

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MAGIC = b"\x89MCAP0\r\n"
START = 1_700_000_000 * 10**9  # nanoseconds: time of the first message
IMAGE = "sensor_msgs/msg/Image"
COMPRESSED = "sensor_msgs/msg/CompressedImage"
CLOUD = "sensor_msgs/msg/PointCloud2"
INFO = "sensor_msgs/msg/CameraInfo"
TF = "tf2_msgs/msg/TFMessage"


def pack_text(text: str | bytes) -> bytes:
    """Return a text with its length."""
    data = text.encode() if isinstance(text, str) else text
    return struct.pack("<I", len(data)) + data


def pack_record(kind: int, body: bytes, size: int | None = None) -> bytes:
    """Return a record, which may declare another size."""
    return struct.pack("<BQ", kind, len(body) if size is None else size) + body


def make_schema(number: int, name: str | bytes) -> bytes:
    """Return the record of a schema."""
    return pack_record(3, struct.pack("<H", number) + pack_text(name) + pack_text("ros2msg") + pack_text(""))


def make_channel(number: int, schema: int, topic: str | bytes) -> bytes:
    """Return the record of a channel."""
    body = struct.pack("<HH", number, schema) + pack_text(topic) + pack_text("cdr") + bytes(4)
    return pack_record(4, body)


def make_topics(topics: dict[str, str]) -> bytes:
    """Return schemas and channels, which have numbers from 1 on, of topics and their types."""
    kinds = list(dict.fromkeys(topics.values()))
    return b"".join(
        [
            *(make_schema(i + 1, kind) for i, kind in enumerate(kinds)),
            *(
                make_channel(i + 1, kinds.index(kind) + 1, topic)
                for i, (topic, kind) in enumerate(topics.items())
            ),
        ]
    )


def make_message(channel: int, time: int, data: bytes) -> bytes:
    """Return the record of a message."""
    return pack_record(5, struct.pack("<HIQQ", channel, 0, time, time) + data)


def make_chunk(
    data: bytes,
    kind: str = "zstd",
    size: int | None = None,
    span: tuple[int, int] = (START, START + 10**12),
    packed: bytes | None = None,
) -> bytes:
    """Return the record of a chunk; `size` and `packed` may be others than those of its data."""
    packed = compress(kind, data) if packed is None else packed
    head = struct.pack("<QQQI", *span, len(data) if size is None else size, 0)
    return pack_record(6, head + pack_text(kind) + struct.pack("<Q", len(packed)) + packed)


def compress(kind: str, data: bytes) -> bytes:
    """Return compressed bytes."""
    if kind == "lz4":
        import lz4.frame

        return bytes(lz4.frame.compress(data))
    return bytes(zstd.compress(data)) if kind == "zstd" else data


def compress_zeros(count: int, window: int = 20) -> bytes:
    """Return zstd of zeros that does not declare their number, but a window of so many bits."""
    one = zstd.ZstdCompressor(options={zstd.CompressionParameter.window_log: window})
    parts = [one.compress(bytes(1 << 20)) for _ in range(count >> 20)]
    return b"".join([*parts, one.compress(bytes(count % (1 << 20))), one.flush()])


def make_file(*records: bytes, index: Sequence[bytes] = ()) -> bytes:
    """Return a file; with an index if there are records of one."""
    body = MAGIC + pack_record(1, pack_text("ros2") + pack_text("")) + b"".join(records)
    body += pack_record(15, bytes(4))
    start = len(body) if index else 0
    return body + b"".join(index) + pack_record(2, struct.pack("<QQI", start, 0, 0)) + MAGIC


def make_index(
    place: int, length: int, size: int, channels: Iterable[int] = (1,), kind: str = "zstd", packed: int = 0
) -> bytes:
    """Return the record of a chunk in an index."""
    span = (START, START + 10**12)
    listed = b"".join(struct.pack("<HQ", channel, 0) for channel in channels)
    body = struct.pack("<QQQQI", *span, place, length, len(listed)) + listed + bytes(8)
    return pack_record(8, body + pack_text(kind) + struct.pack("<QQ", packed, size))


def make_statistics(counts: dict[int, int], chunks: int) -> bytes:
    """Return the statistics of an index."""
    listed = b"".join(struct.pack("<HQ", *entry) for entry in counts.items())
    head = struct.pack("<QHIIIIQQ", sum(counts.values()), 1, len(counts), 0, 0, chunks, START, START + 10**12)
    return pack_record(11, head + struct.pack("<I", len(listed)) + listed)


class Cdr:
    """A message in CDR that is built field by field."""

    def __init__(self, frame: str | bytes = "camera", stamp: int = START) -> None:
        self._data = bytearray(b"\0\1\0\0")
        self.add("iI", stamp // 10**9, stamp % 10**9).add_text(frame)

    def add(self, kinds: str, *values: Any) -> Cdr:
        """Add numbers of types of the module `struct`."""
        for kind, value in zip(kinds, values, strict=True):
            size = struct.calcsize(kind)
            self._data += bytes(-(len(self._data) - 4) % size) + struct.pack("<" + kind, value)
        return self

    def add_text(self, text: str | bytes) -> Cdr:
        """Add a text."""
        data = (text.encode() if isinstance(text, str) else text) + b"\0"
        self.add("I", len(data))
        self._data += data
        return self

    def add_bytes(self, data: bytes, count: int | None = None) -> Cdr:
        """Add a list of bytes, which may declare another length."""
        self.add("I", len(data) if count is None else count)
        self._data += data
        return self

    def end(self) -> bytes:
        """Return the message."""
        return bytes(self._data)


def pack_image(
    width: int, height: int, data: bytes, encoding: str = "16UC1", step: int | None = None, **head: Any
) -> bytes:
    """Return an Image."""
    step = width * {"rgb8": 3}.get(encoding, 2) if step is None else step
    made = Cdr(**head).add("II", height, width).add_text(encoding).add("BI", 0, step)
    return made.add_bytes(data).end()


def pack_compressed(format: str, data: bytes, **head: Any) -> bytes:
    """Return a CompressedImage."""
    return Cdr(**head).add_text(format).add_bytes(data).end()


def pack_info(width: int, height: int, lens: int = 0, **head: Any) -> bytes:
    """Return a CameraInfo with so many numbers of a lens model."""
    k = [float(max(width, 1)), 0.0, width / 2, 0.0, float(max(width, 1)), height / 2, 0.0, 0.0, 1.0]
    made = Cdr(**head).add("II", height, width).add_text("plumb_bob").add("I", lens)
    made.add("d" * min(lens, 5), *[0.0] * min(lens, 5))
    if lens > 5:
        made._data += bytes(8 * (lens - 5))
    return made.add("d" * 9, *k).add("d" * 21, *[0.0] * 21).add("IIIIIB", *[0] * 6).end()


def pack_points(width: int, height: int, data: bytes, fields: int = 3, **head: Any) -> bytes:
    """Return a PointCloud2 of x, y and z, and of other fields without a name."""
    made = Cdr(**head).add("II", height, width).add("I", fields)
    for axis, name in enumerate("xyz"):
        made.add_text(name).add("IBI", 4 * axis, 7, 1)
    if fields > 3:
        one = Cdr("").add_text("").add("IBI", 0, 7, 1).end()
        made._data += one[-20:] * (fields - 3)
    return made.add("?II", False, 12, 12 * width % (1 << 32)).add_bytes(data).add("?", True).end()


def pack_transforms(pairs: Sequence[tuple[str, str]], stamp: int = START, count: int | None = None) -> bytes:
    """Return transforms from parents to children, which may declare another number."""
    made = Cdr("", stamp)
    made._data = bytearray(b"\0\1\0\0")
    made.add("I", len(pairs) if count is None else count)
    for parent, child in pairs:
        made.add("iI", stamp // 10**9, stamp % 10**9).add_text(parent).add_text(child)
        made.add("d" * 7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return made.end()
