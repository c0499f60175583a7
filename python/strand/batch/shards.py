"""Shards: a Parquet file for each unit, written whole; names say what they hold, so listing is enough."""

from __future__ import annotations

import errno
import io
import multiprocessing
import os
import re
import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from strand._core import __version__
from strand.batch.engines import EngineError
from strand.batch.settings import DIGITS, Settings, digest_of
from strand.batch.table import SCHEMA_VERSION
from strand.batch.units import Unit
from strand.batch.work import lost, rows_of
from strand.support.extras import import_extra
from strand.support.files import FileFormatError, read_json, write_bytes, write_json

VERSION_KEY = "strand.schema"
"""What a shard's metadata has the schema's version under."""

SUFFIX = ".parquet"
_FAILED = "-errors" + SUFFIX
# datasets pass over names that begin with an underscore
_ROOT = "_root.json"
_NAME = re.compile(rf"[0-9a-f]{{{DIGITS}}}-[0-9a-f]{{{DIGITS}}}-(\d+)-(\d+|end)(-errors)?\.parquet")
# how the state of what cannot be read begins
_UNREAD = "0" * (DIGITS // 2)
_LEFT = 3600.0  # seconds; writing a shard takes a fraction of one


@dataclass(frozen=True)
class Written:
    """What was done about a unit.

    Attributes
    ----------
    rows, errors : int
        How many rows its shard has, and how many of them say an error.
    """

    rows: int
    errors: int


@dataclass(frozen=True, eq=False)
class Work:
    """Makes and writes the shard of a unit: what every engine is given, to any process.

    Attributes
    ----------
    settings : Settings
    out : str
        The folder of shards, its whole path.
    version : str
        Of the strand that asks.
    """

    settings: Settings
    out: str
    version: str = __version__

    def __call__(self, unit: Unit) -> Written:
        """Work on a unit.

        Raises
        ------
        EngineError
            If this process has another version of strand than the one that asks.
        OSError
            If the shard cannot be written.
        ImportError
            If a package is missing.
        """
        if __version__ != self.version:
            raise EngineError(f"strand is version {__version__} here, and {self.version} where it was asked")
        batch = rows_of(unit, self.settings)
        if orphaned():
            # nobody waits for it, and the next run may be there already, with other settings
            raise SystemExit
        return self._write(unit, batch)

    def give_up(self, unit: Unit, why: str) -> Written:
        """Write the row of a unit that ends whatever process works on it."""
        return self._write(unit, lost(unit, self.settings, why))

    def _write(self, unit: Unit, batch: Any) -> Written:
        errors = len(batch) - batch.column("error").null_count
        good, failed = (
            Path(self.out, name_of(unit, self.settings.digest, with_errors)) for with_errors in (False, True)
        )
        if errors and (good.exists() or self._has_rows(unit)):
            # by a worker that died before it said so, or by another run
            return Written(0, 0)
        good.parent.mkdir(exist_ok=True)
        write_bytes(failed if errors else good, parquet(batch, unit))
        if not errors:
            failed.unlink(missing_ok=True)
        return Written(len(batch), errors)

    def _has_rows(self, unit: Unit) -> bool:
        """Tell whether a recording that cannot be read now has rows: another run may have made some."""
        if unit.digest is not None:
            return False
        found = Path(self.out).glob(f"{recording_key(unit.recording)}*{SUFFIX}")
        return any(not says_unread(path.name) for path in found)


def orphaned() -> bool:
    """Tell whether the driver has ended: its pipes stay open as long as a process lives that it forked."""
    driver = multiprocessing.parent_process()
    return driver is not None and (not driver.is_alive() or os.getppid() != driver.pid)


def parquet(batch: Any, unit: Unit) -> bytes:
    """Return rows as a Parquet file; its metadata says the schema's version and the input's digest."""
    pa, pq = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    content = io.BytesIO()
    # nodes hardly repeat: dictionaries would only take time, and zstd twice that of snappy to save a tenth;
    # Parquet's own types say all that the schema does
    options = {
        "compression": "snappy",
        "use_dictionary": False,
        "store_schema": False,
        "write_statistics": ["recording"],
        "write_page_checksum": True,
    }
    with pq.ParquetWriter(content, batch.schema, **options) as file:
        file.write_table(pa.Table.from_batches([batch]))
        said = {VERSION_KEY: f"{SCHEMA_VERSION}", "strand.input": unit.digest or ""}
        file.add_key_value_metadata(said)
    return content.getvalue()


def recording_key(recording: str) -> str:
    """Return how the names of a recording's shards begin."""
    digest = digest_of(recording)
    return f"{digest[:2]}/{digest}-"


def state_key(unit: Unit, configuration: str) -> str:
    """Return how the names of its shards begin that were made of this input, configuration and version."""
    state = digest_of(f"{unit.digest or ''}\n{configuration}\n{__version__}\n{SCHEMA_VERSION}")
    if unit.digest is None:
        state = _UNREAD + state[len(_UNREAD) :]
    return f"{recording_key(unit.recording)}{state}-"


def name_of(unit: Unit, configuration: str, failed: bool) -> str:
    """Return the name of a unit's shard below the folder of shards."""
    stop = "end" if unit.stop is None else unit.stop
    return f"{state_key(unit, configuration)}{unit.start}-{stop}{_FAILED if failed else SUFFIX}"


def says_errors(name: str) -> bool:
    """Whether a shard of this name has rows with errors."""
    return name.endswith(_FAILED)


def says_unread(name: str) -> bool:
    """Whether a shard of this name says no more than that its recording cannot be read."""
    return name.split("-")[1].startswith(_UNREAD)


class Shards:
    """The shards that a folder held when this was made, without those that this removed.

    Parameters
    ----------
    out : path-like
        The folder, which exists.

    Attributes
    ----------
    out : Path
    names : list of str
        In alphabetical order.
    """

    def __init__(self, out: str | os.PathLike[str]) -> None:
        self.out = Path(out)
        self.names = sorted(names(self.out))

    def there(self, unit: Unit, configuration: str) -> str | None:
        """Return the name of the shard with a unit's rows: of the same input, configuration and version.

        Where stretches hold all rows of a recording that is one unit now, because it could not be opened when
        it was sought, the first of these.
        """
        current = [
            name for name in self._of(unit.recording) if name.startswith(state_key(unit, configuration))
        ]
        for failed in (False, True):
            if (name := name_of(unit, configuration, failed)) in current:
                return name
        return current[0] if unit.whole and _complete(current) else None

    def kept(self, unit: Unit) -> bool:
        """Tell whether a recording that cannot be read now has rows of before."""
        return unit.digest is None and any(not says_unread(name) for name in self._of(unit.recording))

    def remove_unread(self, recording: str) -> int:
        """Remove what says that a recording, or a folder of this name, cannot be read; return how many."""
        return self._remove([name for name in self._of(recording) if says_unread(name)])

    def remove_stale(self, unit: Unit, configuration: str) -> int:
        """Remove shards of a unit's recording that hold other rows than those of today, and return how many.

        Those of another input, configuration or version; errors of a unit that was made since; that of the
        whole recording, where it is stretches. This comes before new ones are written, so that no row is
        there twice.
        """
        current, kept = state_key(unit, configuration), self.there(unit, configuration)
        stale = set()
        if not unit.whole:
            whole = replace(unit, start=0, stop=None)
            stale = {name_of(whole, configuration, failed) for failed in (False, True)}
        if kept is not None and not says_errors(kept):
            stale.add(name_of(unit, configuration, True))
        return self._remove(
            [name for name in self._of(unit.recording) if not name.startswith(current) or name in stale]
        )

    def _remove(self, gone: Sequence[str]) -> int:
        for name in gone:
            del self.names[bisect_left(self.names, name)]
            with suppress(FileNotFoundError):
                (self.out / name).unlink()
        return len(gone)

    def _of(self, recording: str) -> Sequence[str]:
        key = recording_key(recording)
        first = last = bisect_left(self.names, key)
        while last < len(self.names) and self.names[last].startswith(key):
            last += 1
        return self.names[first:last]


def _complete(shards: Sequence[str]) -> bool:
    """Tell whether shards of stretches of one state follow each other from the first frame to the end."""
    found = (_NAME.fullmatch(name.rpartition("/")[2]) for name in shards)
    stops = {one[1]: one[2] for one in found if one}
    frame = "0"
    while frame in stops:
        frame = stops[frame]
    return frame == "end"


def names(out: Path) -> list[str]:
    """Return the names of all shards below a folder of shards, in no order; other files are passed over."""
    found = []
    with os.scandir(out) as folders:
        inner = [entry for entry in folders if len(entry.name) == 2 and entry.is_dir()]
    for folder in inner:
        with os.scandir(folder.path) as entries:
            found += [f"{folder.name}/{entry.name}" for entry in entries if _NAME.fullmatch(entry.name)]
    return found


def root_of(out: Path) -> Path:
    """Return the folder below which a folder of shards names recordings: the current one, if it is new.

    Raises
    ------
    ValueError
        If that folder is not here.
    strand.FileFormatError
        If the file that says it is damaged.
    """
    said = out / _ROOT
    if not said.exists():
        return Path.cwd()
    root = read_json(said)
    if not isinstance(root, str):
        raise FileFormatError(said, "expected the path of a folder")
    if not os.path.isdir(root):
        raise ValueError(
            f"root: {out} names recordings below {root}, which is no folder here; "
            "say where that folder is now (root=, --root)"
        )
    return Path(root)


def made_ready(out: Path, settings: Settings, root: Path) -> None:
    """Make the folder of shards, with files that say its root and what the configuration's digest means.

    What killed processes left half written an hour ago or longer is removed.
    """
    out.mkdir(parents=True, exist_ok=True)
    words = out / f"_configuration-{settings.digest}.json"
    if not words.exists():
        with _or_closed():
            write_json(words, settings.in_words)
    _say_root(out / _ROOT, os.path.abspath(root))
    old = time.time() - _LEFT
    for left in (*out.glob(".strand-*.tmp"), *out.glob("*/.strand-*.tmp")):
        with suppress(FileNotFoundError), _or_closed():
            if left.stat().st_mtime < old:
                left.unlink()


def _say_root(said: Path, root: str) -> None:
    """Write which folder the root is, if that is not what the file says."""
    with suppress(FileFormatError, FileNotFoundError):
        if read_json(said) == root:
            return
    with _or_closed():
        write_json(said, root)


@contextmanager
def _or_closed() -> Iterator[None]:
    """Pass over that a folder may not be written to: it may be complete, else the first shard says so."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
