"""Shards: a Parquet file for each unit, written whole; names say what they hold, so listing is enough."""

from __future__ import annotations

import io
import os
import time
from bisect import bisect_left
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from strand._core import __version__
from strand.batch.settings import Settings, digest_of
from strand.batch.table import SCHEMA_VERSION
from strand.batch.units import Unit
from strand.batch.work import lost, rows_of
from strand.extras import extra
from strand.files import write_bytes, write_json

SUFFIX = ".parquet"
_FAILED = "-errors" + SUFFIX
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
        RuntimeError
            If this process has another version of strand than the one that asks.
        OSError
            If the shard cannot be written.
        ImportError
            If a package is missing.
        """
        if __version__ != self.version:
            raise RuntimeError(f"strand is version {__version__} here, and {self.version} where it was asked")
        return self._write(unit, rows_of(unit, self.settings))

    def give_up(self, unit: Unit, why: str) -> Written:
        """Write the row of a unit that ends whatever process works on it."""
        return self._write(unit, lost(unit, self.settings, why))

    def _write(self, unit: Unit, batch: Any) -> Written:
        errors = len(batch) - batch.column("error").null_count
        name = name_of(unit, self.settings.digest, errors > 0)
        path = Path(self.out, name)
        path.parent.mkdir(exist_ok=True)
        write_bytes(path, parquet(batch, unit))
        return Written(len(batch), errors)


def parquet(batch: Any, unit: Unit) -> bytes:
    """Return rows as a Parquet file."""
    pa, pq = extra("pyarrow"), extra("pyarrow.parquet")
    about = {"strand.schema": f"{SCHEMA_VERSION}", "strand.input": unit.digest}
    table = pa.Table.from_batches([batch.replace_schema_metadata(about)])
    content = io.BytesIO()
    # nodes hardly repeat: dictionaries would only take time, and zstd twice that of snappy to save a tenth;
    # Parquet's own types say all that the schema does
    pq.write_table(
        table,
        content,
        compression="snappy",
        use_dictionary=False,
        store_schema=False,
        write_statistics=["recording"],
    )
    return content.getvalue()


def recording_key(recording: str) -> str:
    """Return how the names of a recording's shards begin."""
    digest = digest_of(recording)
    return f"{digest[:2]}/{digest}-"


def state_key(unit: Unit, configuration: str) -> str:
    """Return how the names of its shards begin that were made of this input, configuration and version."""
    state = digest_of(f"{unit.digest}\n{configuration}\n{__version__}\n{SCHEMA_VERSION}")
    return f"{recording_key(unit.recording)}{state}-"


def name_of(unit: Unit, configuration: str, failed: bool) -> str:
    """Return the name of a unit's shard below the folder of shards."""
    stop = "end" if unit.stop is None else unit.stop
    return f"{state_key(unit, configuration)}{unit.start}-{stop}{_FAILED if failed else SUFFIX}"


def says_errors(name: str) -> bool:
    """Whether a shard of this name has rows with errors."""
    return name.endswith(_FAILED)


class Shards:
    """The shards that a folder held when this was made.

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

    def there(self, unit: Unit, configuration: str) -> Sequence[str]:
        """Return the names of a unit's shards of the same input, configuration and version."""
        wanted = [name_of(unit, configuration, failed) for failed in (False, True)]
        return [name for name in self._of(unit.recording) if name in wanted]

    def remove_stale(self, unit: Unit, configuration: str) -> None:
        """Remove shards of the unit's recording that another input, configuration or version made.

        This comes before the new ones are written, so that no row is there twice at any time.
        """
        current = state_key(unit, configuration)
        for name in self._of(unit.recording):
            if not name.startswith(current):
                self.remove(name)

    def remove(self, name: str) -> None:
        """Remove a shard; one that is gone is no matter."""
        with suppress(FileNotFoundError):
            (self.out / name).unlink()

    def _of(self, recording: str) -> Sequence[str]:
        key = recording_key(recording)
        first = last = bisect_left(self.names, key)
        while last < len(self.names) and self.names[last].startswith(key):
            last += 1
        return self.names[first:last]


def names(out: Path) -> list[str]:
    """Return the names of all shards below a folder of shards, in no order."""
    found = []
    with os.scandir(out) as folders:
        inner = [entry for entry in folders if len(entry.name) == 2 and entry.is_dir()]
    for folder in inner:
        with os.scandir(folder.path) as entries:
            found += [f"{folder.name}/{entry.name}" for entry in entries if entry.name.endswith(SUFFIX)]
    return found


def made_ready(out: Path, settings: Settings) -> None:
    """Make the folder of shards, with a file that says what the configuration's digest stands for.

    What killed processes left half written an hour ago or longer is removed.
    """
    out.mkdir(parents=True, exist_ok=True)
    # datasets pass over names that begin with an underscore
    write_json(out / f"_configuration-{settings.digest}.json", settings.in_words)
    old = time.time() - _LEFT
    for left in out.glob("*/.strand-*.tmp"):
        with suppress(FileNotFoundError):
            if left.stat().st_mtime < old:
                left.unlink()
