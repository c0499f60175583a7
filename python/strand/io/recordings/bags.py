"""Read the messages of ROS 1 bags, ROS 2 bags and MCAP files."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol

from strand.io.budget import Budget
from strand.io.recordings.first_messages import FirstMessage, FirstMessages, read_first_messages
from strand.io.recordings.mcap import McapFile
from strand.io.recordings.message import Message
from strand.io.recordings.ros1_bag import Ros1Bag
from strand.io.recordings.ros2_folder import METADATA, list_storage
from strand.io.recordings.ros_messages import decode
from strand.io.recordings.sqlite_bag import SqliteBag
from strand.io.recordings.unpacking import Limits, Work, is_zstd, unpack_message
from strand.support.files import FileFormatError, open_file
from strand.support.lazy import lazy_property

_FORMATS = {".bag": "ROS 1 bag", ".mcap": "MCAP file", ".db3": "SQLite file of a ROS 2 bag"}
SUFFIXES = tuple(_FORMATS)
_MAX_TIME = 1 << 62  # nanoseconds since 1970: the year 2116


class Storage(Protocol):
    """An open file with messages."""

    topics: dict[str, str]
    counts: dict[str, int]
    span: tuple[int, int] | None

    def close(self) -> None:
        """Close the file."""

    def read_messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording."""

    def read_firsts(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the first message of each topic, in any order."""


_STORAGES: dict[str, Callable[[Path, Limits], Storage]] = {
    ".bag": Ros1Bag,
    ".mcap": McapFile,
    ".db3": SqliteBag,
}


class Bag:
    """An open `.bag`, `.mcap` or `.db3` file, or folder of a ROS 2 bag.

    At most `max_bytes` of decompressed chunks are in memory at once. The index and all else that stays while
    the bag is open takes at most as much.

    Attributes
    ----------
    budget : Budget
        The memory that the index leaves for all but chunks.
    topics : dict of str to str
        The type of each topic's messages.
    counts : dict of str to int
        The number of messages of each topic, by the index.
    span : (int or None, float)
        The time of the first message, nanoseconds since 1970, and the seconds from it to the last one, by the
        index; (None, 0) without a message.
    """

    def __init__(self, path: Path, max_bytes: int) -> None:
        self.path, self.budget, self._closed = path, Budget(max_bytes), False
        self._ros1 = path.suffix.lower() == ".bag" and not path.is_dir()
        self.files = paths = _list_files(path)
        if path.is_dir():
            paths = self.files[1:]
        self._limits = Limits(self.budget, len(paths))
        self._storages: list[tuple[Path, Storage]] = []
        try:
            for one in paths:
                with _convert_errors(one, None):
                    self._storages.append((one, _STORAGES[one.suffix.lower()](one, self._limits)))
        except BaseException:
            self.close()
            raise
        self.topics = {topic: kind for _, one in self._storages for topic, kind in one.topics.items()}
        self.counts = dict.fromkeys(self.topics, 0)
        for _, storage in self._storages:
            for topic, count in storage.counts.items():
                self.counts[topic] += count
        spans = [one.span for _, one in self._storages if one.span is not None]
        first, last = (
            min((start for start, _ in spans), default=None),
            max((end for _, end in spans), default=0),
        )
        self.span = (first, 0.0 if first is None else (last - first) * 1e-9)

    @property
    def format(self) -> str:
        """The kind of bag, in words."""
        if self.path.is_dir():
            return "ROS 2 bag"
        return _FORMATS[self.path.suffix.lower()]

    def close(self) -> None:
        """Close the files."""
        self._closed = True
        while self._storages:
            self._storages.pop()[1].close()

    def find_topics(self, *kinds: str) -> list[str]:
        """Return the topics whose messages have one of these types, in alphabetical order."""
        return sorted(topic for topic, kind in self.topics.items() if kind in kinds)

    def read_messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording."""
        self._require_open()
        for path, storage in self._storages:
            yield from self._read(path, storage.read_messages(set(topics)), self._begin_pass(path))

    def read_firsts(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the first message of each of some topics, in any order, in one pass over the bag."""
        self._require_open()
        left = {topic for topic in topics if self.counts.get(topic)}
        for path, storage in self._storages:
            for message in self._read(path, storage.read_firsts(left), self._begin_pass(path)):
                if message.topic in left:
                    left.remove(message.topic)
                    yield message

    def find_first(self, topic: str) -> FirstMessage | None:
        """Return the first message of a topic with images or points, or of one that describes these.

        FileFormatError is raised if it is damaged. The first call reads those of all such topics.
        """
        first = self._firsts.get(topic)
        if isinstance(first, FileFormatError):
            raise first
        return first

    def decode(self, message: Message) -> Any:
        """Return a message's fields as an object with attributes."""
        with _convert_errors(self.path, message.place):
            return decode(message.kind, message.data, self._ros1)

    @lazy_property
    def _firsts(self) -> FirstMessages:
        return read_first_messages(self.topics, self.read_firsts, self.decode)

    def _require_open(self) -> None:
        if self._closed:
            raise ValueError(f"{self.path}: the recording is closed")

    def _begin_pass(self, path: Path) -> Work:
        return Work(path.stat().st_size, len(self._storages))

    def _read(self, path: Path, messages: Iterator[Message], work: Work) -> Iterator[Message]:
        """Yield messages, decompressed; errors name the last place that was read."""
        last = None
        while True:
            with _convert_errors(path, None if last is None else f"after {last}"):
                message = next(messages, None)
                if message is None:
                    return
                if not 0 <= message.time < _MAX_TIME:
                    raise ValueError(f"a time of {message.time} ns")
                if is_zstd(message.data) and not self._ros1:
                    data = unpack_message(message.data, self._limits.max_message)
                    work.unpack(len(data))
                    message = Message(message.topic, message.kind, message.time, data)
            last = message.place
            yield message


def _list_files(path: Path) -> tuple[Path, ...]:
    """Return the files of a bag, which must be regular files; the metadata of a folder come first."""
    if path.is_dir():
        storage = list_storage(path, SUFFIXES[1:])
        for one in storage:
            open_file(one).close()
        return (path / METADATA, *storage)
    if path.exists() and path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(path, f"expected a {', '.join(SUFFIXES)} file or the folder of a ROS 2 bag")
    open_file(path).close()
    return (path,)


@contextmanager
def _convert_errors(path: Path, place: str | None) -> Iterator[None]:
    """Convert any error that a damaged bag causes to FileFormatError."""
    try:
        yield
    except (FileFormatError, ImportError, MemoryError):
        raise
    except Exception as error:
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL, errno.EOVERFLOW):
            raise
        text = str(error) or type(error).__name__
        raise FileFormatError(path, f"truncated, damaged or not a bag ({text})", place) from error


def is_bag(path: str | os.PathLike[str]) -> bool:
    """Tell whether a path is a bag, by its suffix or by the metadata in the folder."""
    place = Path(path)
    return (place / METADATA).exists() if place.is_dir() else place.suffix.lower() in SUFFIXES
