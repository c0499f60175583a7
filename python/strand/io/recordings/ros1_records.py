"""The records of ROS 1 bags, of which each has fields with names, and data."""

from __future__ import annotations

from pathlib import PurePosixPath
from struct import Struct
from struct import error as struct_error
from typing import BinaryIO, NamedTuple

from strand.support.files import read_at

# kinds of records
MESSAGE = 2
BAG = 3
INDEX = 4
CHUNK = 5
CHUNK_INFO = 6
CONNECTION = 7
LENGTH = Struct("<I")
_TIME = Struct("<II")
_NUMBERS = {1: Struct("<B"), 4: LENGTH, 8: Struct("<Q")}  # by their bytes
_MAX_HEAD = 1 << 16  # bytes of all fields of a record
_MAX_FIELDS = 64  # fields of a record
_MAX_KEY = 64  # bytes of the name of a field
_MAX_NAME = 1024  # bytes of the name of a topic or type
_MAX_SKIPPED = 16  # connections before a message; rosbag writes one


class Fields:
    """The fields of a record by name; ValueError is raised if one is missing or of another kind."""

    def __init__(self, data: bytes | memoryview) -> None:
        view, at = memoryview(data), 0
        self._parts: dict[bytes, memoryview] = {}
        while at < len(view):
            size = read_length(view, at)
            at += LENGTH.size
            name, sign, _ = bytes(view[at : at + min(size, _MAX_KEY)]).partition(b"=")
            if size > len(view) - at or not sign or len(self._parts) == _MAX_FIELDS:
                raise ValueError("damaged fields of a record")
            self._parts[name] = view[at + len(name) + 1 : at + size]
            at += size

    def get_number(self, name: str, size: int) -> int:
        """Return a number of so many bytes."""
        part = self._find(name)
        if len(part) != size:
            raise ValueError(f"expected {name} of {size} bytes, got {len(part)}")
        return int(_NUMBERS[size].unpack(part)[0])

    def get_time(self, name: str) -> int:
        """Return a time, nanoseconds since 1970."""
        part = self._find(name)
        if len(part) != _TIME.size:
            raise ValueError(f"expected {name} of {_TIME.size} bytes, got {len(part)}")
        sec, nanosec = _TIME.unpack(part)
        return int(sec) * 10**9 + int(nanosec)

    def get_name(self, name: str, default: str | None = None) -> str:
        """Return a short text; the default if there is none."""
        if default is not None and name.encode() not in self._parts:
            return default
        part = self._find(name)
        if len(part) > _MAX_NAME:
            raise ValueError(f"expected {name} of at most {_MAX_NAME} bytes, got {len(part)}")
        return bytes(part).decode()

    def _find(self, name: str) -> memoryview:
        if name.encode() not in self._parts:
            raise ValueError(f"a record lacks {name}")
        return self._parts[name.encode()]


class Record(NamedTuple):
    """The fields of a record, and where its data start and stop."""

    fields: Fields
    start: int
    stop: int


def read_length(data: bytes | memoryview, at: int) -> int:
    """Return the length at a place of data."""
    try:
        return int(LENGTH.unpack_from(data, at)[0])
    except struct_error:
        raise ValueError("the bag ends within a record") from None


def read_record(file: BinaryIO, at: int, kind: int) -> Record:
    """Return the record at a place of a file, which must be of a kind; its data may be cut."""
    size = read_length(read_at(file, at, LENGTH.size), 0)
    if size > _MAX_HEAD:
        raise ValueError(f"a record with fields of {size} bytes")
    head = read_at(file, at + LENGTH.size, size + LENGTH.size)
    fields = Fields(head[:size])
    if fields.get_number("op", 1) != kind:
        raise ValueError(f"expected a record of kind {kind}, got {fields.get_number('op', 1)}")
    start = at + size + 2 * LENGTH.size
    return Record(fields, start, start + read_length(head, size))


def find_message(chunk: memoryview, place: int) -> tuple[Fields, memoryview]:
    """Return the fields and the data of a message in a decompressed chunk; connections may come before it."""
    for _ in range(_MAX_SKIPPED):
        size = read_length(chunk, place)
        start = place + 2 * LENGTH.size + size
        fields = Fields(chunk[place + LENGTH.size : start - LENGTH.size])
        stop = start + read_length(chunk, start - LENGTH.size)
        if stop > len(chunk):
            raise ValueError("a chunk ends within a message")
        kind = fields.get_number("op", 1)
        if kind == MESSAGE:
            return fields, chunk[start:stop]
        if kind != CONNECTION:
            break
        place = stop
    raise ValueError("the index leads to no message")


def normalize_topic(name: str) -> str:
    """Return a topic without empty parts."""
    return "/" * name.startswith("/") + "/".join(part for part in name.split("/") if part)


def normalize_kind(name: str) -> str:
    """Return a type by its name in ROS 2: "sensor_msgs/msg/Image" for "sensor_msgs/Image"."""
    path = PurePosixPath(name)
    return str(path if path.parent.name == "msg" else path.parent / "msg" / path.name)
