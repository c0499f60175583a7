"""Tricks with ROS 1 bags, SQLite files and folders of ROS 2 bags."""

from __future__ import annotations

import bz2
import sqlite3
import struct
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import lz4.frame
import numpy as np

from shared.tricks import Trick
from shared.tricks.mcap_files import DEPTH, FRAME, SECONDS, read_frames, try_recording
from shared.tricks.mcap_parts import IMAGE, START, compress, compress_zeros, make_chunk, make_file

K = {"intrinsics": np.eye(3)}
SECOND = START // 10**9
_MAGIC = b"#ROSBAG V2.0\n"
_TABLES = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
"""
_METADATA = "rosbag2_bagfile_information:\n  relative_file_paths:\n"


def list_tricks() -> list[Trick]:
    """Return the tricks with bags."""
    many = (1 << 32) - 1
    bombs = {"bz2": bz2.compress, "lz4": lz4.frame.compress}
    zeros = {kind: _later(pack, 1 << 26) for kind, pack in bombs.items()}
    near = {kind: _later(pack, 15 << 20) for kind, pack in bombs.items()}
    bags: dict[str, Callable[[], bytes]] = {
        **{
            f"{kind} of 64 MiB": lambda kind=kind: make_bag([(kind, zeros[kind](), 1 << 26)])
            for kind in bombs
        },
        **{
            f"{kind} that declares little": lambda kind=kind: make_bag([(kind, zeros[kind](), 1000)])
            for kind in bombs
        },
        "no compression that declares much": lambda: make_bag([("none", ROS1_FRAME, 1 << 31)]),
        "many chunks": lambda: make_bag([("bz2", near["bz2"](), 15 << 20)] * 300),
        "chunks that alternate": lambda: _alternate(near["bz2"]()),
        "one chunk many times": lambda: make_bag([("bz2", near["bz2"](), 15 << 20)], times=3000),
        "many connections": lambda: make_bag([("none", ROS1_FRAME, None)], connections=12_000),
        "connections that are not there": lambda: make_bag([("none", ROS1_FRAME, None)], declared=(many, 1)),
        "chunks that are not there": lambda: make_bag([("none", ROS1_FRAME, None)], declared=(1, many)),
        "many messages in the index": lambda: make_bag([("none", ROS1_FRAME, None)], entries=400_000),
        "many fields": lambda: make_bag([("none", ROS1_FRAME, None)], more=b"\1\0\0\0a=" * 3_000_000),
        "one message many times": lambda: make_bag(
            [("bz2", near["bz2"](), 15 << 20)], entries=2000, same=True
        ),
        "messages within messages": _nest,
        "a message of much": lambda: make_bag(
            [("none", pack_ros1(2, {"conn": b"\0" * 4}, b"", 1 << 31), None)]
        ),
        "connections before a message": lambda: make_bag([("none", pack_ros1(7, {}) * 900_000, None)]),
    }
    files: dict[str, Callable[[Any], None]] = {
        "a view without end": _make_view,
        "a view that poses as a table": lambda base: _pose(base, "CREATE VIEW messages AS " + _ENDLESS),
        "a generated message": lambda base: _generate(base, "messages", "data BLOB AS (zeroblob(900000000))"),
        "a generated topic": lambda base: _generate(
            base, "topics", "name TEXT AS (hex(zeroblob(400000000)))"
        ),
        "a virtual table": lambda base: _pose(
            base, "CREATE VIRTUAL TABLE messages USING rtree(id, timestamp, data)"
        ),
        "many tables": _add_tables,
        "a long topic": lambda base: base.execute("UPDATE topics SET name = hex(zeroblob(30000000))"),
        "many topics": _add_topics,
        "a message of much": lambda base: base.execute("UPDATE messages SET data = zeroblob(20 << 20)"),
        "a zstd message of 2 GiB": lambda base: _set_message(base, compress_zeros(1 << 31)),
        "a zstd message that declares 256 MiB": lambda base: _set_message(
            base, compress("zstd", bytes(1 << 28))
        ),
        "many zstd messages": _pack_messages,
        "a topic for each message": lambda base: base.execute(
            "UPDATE messages SET topic_id = hex(zeroblob(9000000))"
        ),
    }
    return [
        *(try_recording(f"bag of {name}", "a.bag", make, **K) for name, make in bags.items()),
        *(_try_sqlite(name, change) for name, change in files.items()),
        _try_sqlite("many messages without an index", _add_messages, True),
        _try_folder("many paths of one file", lambda folder: _list_paths(folder, ["a.mcap"] * 15_000), True),
        _try_folder("many files", _write_files),
        _try_folder("yaml of many merges", _merge_yaml, True),
        _try_folder("long yaml", lambda folder: _list_paths(folder, ["a.mcap"], "a: b\n" * 60_000)),
    ]


# ROS 1.


def pack_ros1(kind: int, fields: dict[str, bytes], data: bytes = b"", size: int | None = None) -> bytes:
    """Return a record of a ROS 1 bag, which may declare another size."""
    head = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in {"op": bytes([kind]), **fields}.items()
    )
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(data) if size is None else size) + data


def _pack_image() -> bytes:
    """Return an Image in the encoding of ROS 1."""
    head = struct.pack("<IIII", 0, SECOND, 0, 6) + b"camera" + struct.pack("<III", 6, 8, 5) + b"16UC1"
    return head + struct.pack("<BII", 0, 16, 96) + struct.pack("<48H", *[500] * 48)


_TIME = struct.pack("<II", SECOND, 0)
ROS1_FRAME = pack_ros1(2, {"conn": bytes(4), "time": _TIME}, _pack_image())


def make_bag(
    chunks: Sequence[tuple[str, bytes, int | None]],
    connections: int = 1,
    entries: int = 1,
    times: int = 1,
    declared: tuple[int, int] | None = None,
    more: bytes = b"",
    same: bool = False,
    spread: int = 0,
    order: Callable[[int], int] = lambda chunk: chunk,
) -> bytes:
    """Return a bag of chunks: their compression, their bytes, and the size that they declare."""
    body, places = bytearray(_MAGIC + bytes(4200)), []
    for number, (kind, packed, size) in enumerate(chunks):
        places.append(len(body))
        size = len(packed) if size is None else size
        body += pack_ros1(5, {"compression": kind.encode(), "size": struct.pack("<I", size)}, packed)
        seconds = [SECOND + (0 if same else order(number) + i) for i in range(entries)]
        listed = b"".join(struct.pack("<III", each, 0, i * spread) for i, each in enumerate(seconds))
        fields = {"ver": struct.pack("<I", 1), "conn": bytes(4), "count": struct.pack("<I", entries)}
        body += pack_ros1(4, fields, listed)
    index = len(body)
    own = b"".join(
        struct.pack("<I", len(field)) + field
        for field in (b"topic=/depth", b"type=sensor_msgs/Image", b"md5sum=", b"message_definition=")
    )
    for number in range(connections):
        topic = f"/depth{number}" if number else "/depth"
        body += pack_ros1(7, {"conn": struct.pack("<I", number), "topic": topic.encode()}, own + more)
    for place in places * times:
        fields = {"ver": struct.pack("<I", 1), "chunk_pos": struct.pack("<Q", place), "start_time": _TIME}
        fields |= {"end_time": _TIME, "count": struct.pack("<I", 1)}
        body += pack_ros1(6, fields, struct.pack("<II", 0, entries))
    counts = declared or (connections, len(places) * times)
    fields = {"index_pos": struct.pack("<Q", index), "conn_count": struct.pack("<I", counts[0])}
    head = pack_ros1(3, fields | {"chunk_count": struct.pack("<I", counts[1])}, b"")
    body[len(_MAGIC) : len(_MAGIC) + len(head)] = head
    return bytes(body)


def _alternate(packed: bytes) -> bytes:
    """Return a bag of chunks whose messages alternate in time."""
    chunks = [("bz2", packed, 15 << 20)] * 6
    return make_bag(chunks, entries=2000, order=lambda chunk: 0)


def _nest() -> bytes:
    """Return a bag of images of which each holds all that follow."""
    fields, count, total = {"conn": bytes(4), "time": _TIME}, 3000, 7 << 20
    image = _pack_image()[:-100]
    size = len(pack_ros1(2, fields, image + bytes(4)))
    parts = []
    for left in range(total - size, total - size - count * size, -size):
        parts.append(pack_ros1(2, fields, image + struct.pack("<I", left), left + len(image) + 4))
    data = b"".join(parts)
    return make_bag(
        [("bz2", bz2.compress(data + bytes(total - len(data))), total)], entries=count, same=True, spread=size
    )


def _later(pack: Callable[[bytes], bytes], size: int) -> Callable[[], bytes]:
    """Return a function that packs a frame and zeros."""
    return lambda: pack(ROS1_FRAME + bytes(size - len(ROS1_FRAME)))


# SQLite.

_ENDLESS = (
    "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i id, 1 topic_id, i timestamp, x'00' data FROM n"
)


def _try_sqlite(name: str, change: Callable[[Any], Any], answered: bool = False) -> Trick:
    """Return a trick with an SQLite file of one message, which is changed."""

    def write(folder: Path) -> None:
        with closing(sqlite3.connect(folder / "a.db3")) as base, base:
            base.executescript(_TABLES)
            base.execute("INSERT INTO topics VALUES (1, '/depth', ?, 'cdr')", (IMAGE,))
            base.execute("INSERT INTO messages VALUES (1, 1, ?, ?)", (START, DEPTH))
            base.execute("PRAGMA writable_schema = ON")
            change(base)

    return Trick(
        f"sqlite of {name}", write, lambda folder: read_frames(folder / "a.db3", **K), answered, SECONDS
    )


def _make_view(base: Any) -> None:
    base.executescript(f"DROP TABLE messages; CREATE VIEW messages AS {_ENDLESS};")


def _pose(base: Any, made: str) -> None:
    """Put other words where the file keeps how a table was made."""
    base.execute("UPDATE sqlite_master SET sql = ? WHERE name = 'messages'", (made,))


def _generate(base: Any, table: str, column: str) -> None:
    """Make a column that is computed from nothing."""
    base.executescript(
        _TABLES.replace("CREATE TABLE ", "DROP TABLE IF EXISTS old; --\nCREATE TABLE IF NOT EXISTS ")
    )
    name = column.split()[0]
    base.executescript(
        f"ALTER TABLE {table} RENAME COLUMN {name} TO unused; ALTER TABLE {table} ADD COLUMN {column};"
    )


def _add_tables(base: Any) -> None:
    rows = ((f"t{i}", f"t{i}", f"CREATE TABLE t{i}(a)") for i in range(100_000))
    base.executemany("INSERT INTO sqlite_master VALUES ('table', ?, ?, 2, ?)", rows)


def _add_topics(base: Any) -> None:
    base.executemany(
        "INSERT INTO topics VALUES (?, ?, ?, 'cdr')", ((i, f"/{i}", IMAGE) for i in range(2, 20_000))
    )


def _add_messages(base: Any) -> None:
    rows = ((i, 1, START - i, DEPTH) for i in range(2, 1000))
    base.executemany("INSERT INTO messages VALUES (?, ?, ?, ?)", rows)


def _pack_messages(base: Any) -> None:
    data = compress("zstd", DEPTH[:-100] + struct.pack("<I", 7 << 20) + bytes(7 << 20))
    base.executemany(
        "INSERT INTO messages VALUES (?, 1, ?, ?)", ((i, START - i, data) for i in range(2, 400))
    )


def _set_message(base: Any, data: bytes) -> None:
    base.execute("UPDATE messages SET data = ?", (data,))


# Folders.


def _try_folder(name: str, write: Callable[[Path], object], answered: bool = False) -> Trick:
    def make(folder: Path) -> None:
        (folder / "bag").mkdir()
        (folder / "bag" / "a.mcap").write_bytes(make_file(FRAME))
        write(folder / "bag")

    return Trick(
        f"folder of {name}", make, lambda folder: read_frames(folder / "bag", **K), answered, SECONDS
    )


def _list_paths(folder: Path, names: Sequence[str], more: str = "") -> None:
    listed = "".join(f"  - {name}\n" for name in names)
    (folder / "metadata.yaml").write_text(_METADATA + listed + more)


def _write_files(folder: Path) -> None:
    """Write many files that each decompress to hundreds of megabytes."""
    chunk = make_chunk(FRAME + b"\x80" + struct.pack("<Q", 15 << 20) + bytes(15 << 20))
    data, names = make_file(*[chunk] * 20), [f"{i}.mcap" for i in range(200)]
    for name in names:
        (folder / name).write_bytes(data)
    _list_paths(folder, names)


def _merge_yaml(folder: Path) -> None:
    lines = ["a0: &a0 {x: 1}\n"]
    lines += [f"a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 40)]
    _list_paths(folder, ["a.mcap"], "".join(lines))
