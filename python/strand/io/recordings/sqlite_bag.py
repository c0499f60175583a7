"""Read the messages of SQLite files of ROS 2 bags in the order of time.

A hostile file may compute its rows: views, virtual tables and generated columns of a few bytes can take any
memory and time. So a file has plain tables, and SQLite may take only as many steps as its size allows.
"""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from strand.io.recordings.message import Message
from strand.io.recordings.unpacking import Limits
from strand.support.files import open_file

_PLAIN = ("CREATE TABLE ", "CREATE INDEX ", "CREATE UNIQUE INDEX ")  # how SQLite keeps what rosbag2 makes
_TABLES = ("topics", "messages")
_CACHE = 4096  # kilobytes of pages in memory; a file may ask for more
_TEXT = 1 << 20  # bytes of any text or row, at least
_TOPIC_BYTES = 2048  # memory of a topic, and of what readers keep of its first message
_MAX_NAME = 1024  # letters of the name of a topic or type
_STEPS_AT_ONCE = 1000  # steps of SQLite between two looks at their number
_OPENING_STEPS = 1 << 17  # steps while SQLite reads the list of tables
_SPARE_STEPS = 1 << 24  # steps of a pass over any file
_STEP_SHARE = 64  # steps beyond these for each byte of the file


class SqliteBag:
    """An open `.db3` file; ValueError or sqlite3.Error is raised where it is damaged.

    Attributes
    ----------
    topics : dict of str to str
        The type of each topic's messages.
    counts : dict of str to int
        The number of messages of each topic.
    span : (int, int) or None
        Times of the first and the last message, nanoseconds since 1970; None without a message.
    """

    def __init__(self, path: Path, limits: Limits) -> None:
        open_file(path).close()
        self._limits, self._size = limits, path.stat().st_size
        self._left = _OPENING_STEPS
        uri = f"{path.absolute().as_uri()}?mode=ro&immutable=1"
        self._base = sqlite3.connect(uri, uri=True, check_same_thread=False, isolation_level=None)
        try:
            self._base.set_progress_handler(self._count_steps, _STEPS_AT_ONCE)
            if sys.version_info >= (3, 11):
                self._base.setlimit(
                    sqlite3.SQLITE_LIMIT_LENGTH, min(max(limits.max_bytes, _TEXT), (1 << 31) - 1)
                )
            self._require_plain_tables()
            self._base.execute(f"PRAGMA cache_size=-{_CACHE}")
            self._names = self._read_names(path)
            self._firsts: dict[int, int] = {}  # the row of each topic's first message
            self._read_counts()
        except BaseException:
            self._base.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._base.close()

    def read_messages(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the messages of some topics in the order of recording.

        `topics` may lose entries meanwhile; their messages are not read any more.
        """
        self._allow_pass()
        wanted = {key for key, (topic, _) in self._names.items() if topic in topics}
        query, left = "SELECT topic_id, rowid FROM messages ORDER BY timestamp", self._size
        for key, row in self._base.execute(query):
            if key in wanted and self._names[key][0] in topics:
                message = self._read_message(row)
                left -= len(message.data)
                if left < 0:
                    raise ValueError("messages take more bytes than the file")
                yield message

    def read_firsts(self, topics: Collection[str]) -> Iterator[Message]:
        """Yield the first message of each topic."""
        self._allow_pass()
        for key, row in self._firsts.items():
            if self._names[key][0] in topics:
                yield self._read_message(row)

    def _read_message(self, row: int) -> Message:
        data = "CASE WHEN length(data) <= ? THEN data END"
        query = f"SELECT topic_id, timestamp, {data}, length(data) FROM messages WHERE rowid = ?"
        key, time, data, size = self._base.execute(query, (self._limits.max_message, row)).fetchone()
        topic, kind = self._names[key]
        if isinstance(size, int):
            self._limits.check_message(size)
        if not isinstance(data, bytes) or not isinstance(time, int):
            raise ValueError(f"{topic}: a message of another type than bytes")
        return Message(topic, kind, time, data)

    # Opening.

    def _require_plain_tables(self) -> None:
        made = self._base.execute("SELECT sql FROM sqlite_master WHERE sql NOT NULL").fetchall()
        if not all(isinstance(sql, str) and sql.startswith(_PLAIN) for (sql,) in made):
            raise ValueError("expected plain tables, got views, virtual tables or triggers")
        for table in _TABLES:
            columns = self._base.execute(f"PRAGMA table_xinfo({table})").fetchall()
            if not columns:
                raise ValueError(f"no table {table}")
            if any(hidden for *_, hidden in columns):
                raise ValueError(f"expected plain columns, got generated ones in {table}")

    def _read_names(self, path: Path) -> dict[int, tuple[str, str]]:
        """Return topic and type by number."""
        self._allow_pass()
        found = {}
        for key, *texts in self._base.execute(
            "SELECT id, name, type, serialization_format FROM topics ORDER BY id"
        ):
            topic, kind, encoding = (self._check_name(text) for text in texts)
            if encoding != "cdr":
                raise ValueError(f"{topic}: expected messages in CDR, got {encoding[:40]!r}")
            self._limits.budget.take(path, _TOPIC_BYTES + 4 * len(topic))
            found[key] = topic, kind
        return found

    @staticmethod
    def _check_name(text: Any) -> str:
        if not isinstance(text, str) or len(text) > _MAX_NAME:
            raise ValueError(f"expected names of at most {_MAX_NAME} letters for topics and types")
        return text

    def _read_counts(self) -> None:
        self._allow_pass()
        self.topics = dict(self._names.values())
        self.counts = dict.fromkeys(self.topics, 0)
        query = "SELECT topic_id, count(*), min(timestamp), rowid FROM messages GROUP BY topic_id"
        times = []
        for key, count, time, row in self._base.execute(query):
            if key in self._names:
                self.counts[self._names[key][0]] += count
                self._firsts[key] = row
                times.append(time)
        last = self._base.execute("SELECT max(timestamp) FROM messages").fetchone()[0]
        if not all(isinstance(time, int) for time in [*times, last or 0]):
            raise ValueError("times that are no whole numbers")
        self.span = (min(times), max(last, min(times))) if times else None

    # Steps.

    def _allow_pass(self) -> None:
        """Allow SQLite the steps of another pass over the file."""
        self._left = _SPARE_STEPS // self._limits.files + _STEP_SHARE * self._size

    def _count_steps(self) -> int:
        """Tell SQLite whether to stop."""
        self._left -= _STEPS_AT_ONCE
        return int(self._left < 0)
