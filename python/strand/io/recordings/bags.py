"""Read the messages of ROS 1 bags, ROS 2 bags and MCAP files through rosbags."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from strand.io.recordings.limits import (
    YAML_BYTES,
    GuardedPath,
    bound_mcap,
    bound_rosbag1,
    count_open_bytes,
    decompress_zstd,
)
from strand.support.extras import import_extra
from strand.support.files import FileFormatError, open_file, read_bytes

_FORMATS = {".bag": "ROS 1 bag", ".mcap": "MCAP file", ".db3": "SQLite file of a ROS 2 bag"}
SUFFIXES = tuple(_FORMATS)
TRANSFORMS = "tf2_msgs/msg/TFMessage"  # the type of TF's messages
METADATA = "metadata.yaml"  # the file that makes a folder a ROS 2 bag
_MAX_TIME = 1 << 62  # nanoseconds since 1970: the year 2116
_RENAMED = {"tf/msg/tfMessage": TRANSFORMS}  # older names of types


@dataclass(frozen=True)
class Message:
    """An encoded message.

    Attributes
    ----------
    topic : str
    kind : str
        Type by its name in ROS 2, such as "sensor_msgs/msg/Image".
    time : int
        Time of recording, nanoseconds since 1970.
    data : bytes
    """

    topic: str
    kind: str
    time: int
    data: bytes

    @property
    def place(self) -> str:
        """Topic and time, for errors."""
        return f"{self.topic} at {self.time * 1e-9:.3f} s"


class Bag:
    """An open `.bag`, `.mcap` or `.db3` file, or folder of a ROS 2 bag.

    Messages are decoded with ROS's own definitions; definitions in the bag are ignored. At most `max_bytes`
    of the bag are in memory at once.

    Attributes
    ----------
    topics : dict of str to str
        The type of each topic's messages.
    counts : dict of str to int
        The number of messages of each topic, by the index.
    span : (int or None, float)
        The time of the first message, nanoseconds since 1970, and the seconds from it to the last one, by the
        index; (None, 0) without a message.
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path, self._max_bytes = path, max_bytes
        self.files = _list_files(path)
        self._ros1 = path.suffix.lower() == ".bag" and not path.is_dir()
        self._zstd = self._closed = False
        self._indexed = True
        with _convert_errors(path, None), ExitStack() as stack:
            self._reader = self._open(stack)
            self.topics = {one.topic: one.msgtype for one in self._reader.connections}
            self.counts = {topic: 0 for topic in self.topics}
            for one in self._reader.connections:
                self.counts[one.topic] += one.msgcount
            self.span = self._read_span()
            self._stack = stack.pop_all()

    @property
    def format(self) -> str:
        """The kind of bag, in words."""
        if self.path.is_dir():
            return "ROS 2 bag"
        return _FORMATS[self.path.suffix.lower()]

    def close(self) -> None:
        """Close the files."""
        self._closed = True
        self._stack.close()

    def find_topics(self, *kinds: str) -> list[str]:
        """Return the topics whose messages have one of these types, in alphabetical order."""
        return sorted(topic for topic, kind in self.topics.items() if kind in kinds)

    def read_messages(self, topics: Sequence[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording."""
        if self._closed:
            raise ValueError(f"{self.path}: the recording is closed")
        wanted = [one for one in self._reader.connections if one.topic in topics]
        if not wanted:
            return
        with ExitStack() as own:
            reader, last = self._reader, None
            with _convert_errors(self.path, None):
                # without an index, rosbags reads from the file's position, which two passes would share
                if not self._indexed:
                    reader = self._open(own)
                stream = reader.messages(connections=wanted)
            while True:
                with _convert_errors(self.path, None if last is None else f"after {last.place}"):
                    found = next(stream, None)
                    if found is None:
                        return
                    connection, time, data = found
                    if self._zstd:
                        data = decompress_zstd(data, self._max_bytes)
                    if not 0 <= time < _MAX_TIME:
                        raise ValueError(f"a time of {time} ns")
                    last = Message(connection.topic, connection.msgtype, time, bytes(data))
                yield last

    def read_first(self, topic: str) -> Message | None:
        """Return the first message of a topic, or None."""
        return next(self.read_messages([topic]), None)

    def decode(self, message: Message) -> Any:
        """Return a message's fields as an object with attributes."""
        with _convert_errors(self.path, message.place):
            store = _load_types(self._ros1)
            decode = store.deserialize_ros1 if self._ros1 else store.deserialize_cdr
            return decode(message.data, _RENAMED.get(message.kind, message.kind))

    def _read_span(self) -> tuple[int | None, float]:
        reader = self._reader
        if not any(self.counts.values()):
            return None, 0.0
        start, last = int(reader.start_time), int(reader.end_time) - 1
        return start, max(last - start, 0) * 1e-9

    def _open(self, stack: ExitStack) -> Any:
        path = GuardedPath(self.path)
        if self._ros1:
            reader = stack.enter_context(import_extra("rosbags.rosbag1").Reader(path))
            reader.bio.lift_limit()
            bound_rosbag1(reader, self._max_bytes)
            return reader
        bound_mcap()
        reader = stack.enter_context(import_extra("rosbags.rosbag2").Reader(path))
        for storage in getattr(reader.storage, "storages", [reader.storage]):
            if hasattr(storage, "bio"):
                storage.bio.lift_limit()
                self._indexed &= bool(storage.chunks)
                held = count_open_bytes(storage.chunks)
                if held > self._max_bytes:
                    reason = f"chunks of {held} bytes overlap in time, more than max_bytes={self._max_bytes}"
                    raise FileFormatError(storage.path, reason)
            else:  # by default, SQLite allocates values of any size that a file declares
                most = min(self._max_bytes, (1 << 31) - 1)
                storage.dbconn.limit(import_extra("apsw").SQLITE_LIMIT_LENGTH, most)
        if reader.compression_mode == "message":
            # decompress here, as rosbags sets no limit
            reader.storage.metadata = reader.storage.metadata._replace(compression_mode=None)
            self._zstd = True
        return reader


def _list_files(path: Path) -> tuple[Path, ...]:
    """Return the files of a bag, which must be regular files."""
    if not path.is_dir():
        if path.exists() and path.suffix.lower() not in SUFFIXES:
            raise FileFormatError(path, f"expected a {', '.join(SUFFIXES)} file or the folder of a ROS 2 bag")
        open_file(path).close()
        return (path,)
    read_bytes(path / METADATA, YAML_BYTES)
    storage = sorted(one for one in path.iterdir() if one.suffix in SUFFIXES)
    for one in storage:
        open_file(one).close()
    return (path / METADATA, *storage)


@cache
def _load_types(ros1: bool) -> Any:
    typesys = import_extra("rosbags.typesys")
    store = typesys.get_typestore(typesys.Stores.ROS1_NOETIC if ros1 else typesys.Stores.LATEST)
    # rosbags lacks this type for ROS 1
    definition = "geometry_msgs/TransformStamped[] transforms"
    store.register(typesys.get_types_from_msg(definition, TRANSFORMS))
    return store


@contextmanager
def _convert_errors(path: Path, place: str | None) -> Iterator[None]:
    """Convert any error that rosbags raises for a damaged bag to FileFormatError."""
    try:
        yield
    except (FileFormatError, ImportError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL, errno.EOVERFLOW):
            raise
        text = str(error) or type(error).__name__
        raise FileFormatError(path, f"truncated, damaged or not a bag ({text})", place) from error


def is_recording(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is a recording, by its suffix or by the metadata in the folder."""
    place = Path(path)
    return (place / METADATA).exists() if place.is_dir() else place.suffix.lower() in SUFFIXES
