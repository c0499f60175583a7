"""The work that every engine does, in any process: make the shard of a unit."""

from __future__ import annotations

import io
import multiprocessing
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from strand._core import __version__
from strand.batch.engines import EngineError
from strand.batch.rows import make_error_row, make_rows
from strand.batch.settings import Settings
from strand.batch.shards import SUFFIX, VERSION_KEY, is_unreadable, make_recording_key, name_shard
from strand.batch.table import SCHEMA_VERSION
from strand.batch.units import Unit
from strand.support.extras import import_extra
from strand.support.files import write_bytes


@dataclass(frozen=True)
class ShardCounts:
    """The contents of a shard that was written.

    Attributes
    ----------
    rows : int
        Number of rows.
    errors : int
        Number of rows with an error.
    """

    rows: int
    errors: int


@dataclass(frozen=True, eq=False)
class Work:
    """Makes and writes the shard of a unit; it can be pickled.

    Attributes
    ----------
    settings : Settings
    out : str
        Absolute path of the folder of shards.
    version : str
        The driver's version of strand.
    """

    settings: Settings
    out: str
    version: str = __version__

    def __call__(self, unit: Unit) -> ShardCounts:
        """Make the shard of a unit.

        Raises
        ------
        EngineError
            If this process has another version of strand than the driver.
        OSError
            If the shard cannot be written.
        ImportError
            If a package is missing.
        """
        if __version__ != self.version:
            raise EngineError(
                f"strand has version {__version__} in a worker, and {self.version} in the driver"
            )
        batch = make_rows(unit, self.settings)
        if is_orphaned():
            # the next run may have started already, with other settings
            raise SystemExit
        return self._write(unit, batch)

    def give_up(self, unit: Unit, error: str) -> ShardCounts:
        """Write the error row of a unit on which every process dies."""
        return self._write(unit, make_error_row(unit, self.settings, error))

    def _write(self, unit: Unit, batch: Any) -> ShardCounts:
        errors = len(batch) - batch.column("error").null_count
        good, failed = (
            Path(self.out, name_shard(unit, self.settings.digest, with_errors))
            for with_errors in (False, True)
        )
        if errors and (good.exists() or self._has_rows(unit)):
            # by a worker that died before it could answer, or by another run
            return ShardCounts(0, 0)
        good.parent.mkdir(exist_ok=True)
        write_bytes(failed if errors else good, encode_parquet(batch, unit))
        if not errors:
            failed.unlink(missing_ok=True)
        return ShardCounts(len(batch), errors)

    def _has_rows(self, unit: Unit) -> bool:
        """Tell whether another run has made rows of a recording that cannot be read now."""
        if unit.digest is not None:
            return False
        paths = Path(self.out).glob(f"{make_recording_key(unit.recording)}*{SUFFIX}")
        return any(not is_unreadable(path.name) for path in paths)


def is_orphaned() -> bool:
    """Tell whether the driver has ended; its pipes stay open while any process that it forked lives."""
    driver = multiprocessing.parent_process()
    return driver is not None and (not driver.is_alive() or os.getppid() != driver.pid)


def encode_parquet(batch: Any, unit: Unit) -> bytes:
    """Return rows as a Parquet file, with the schema's version and the input's digest in its metadata."""
    pa, pq = import_extra("pyarrow"), import_extra("pyarrow.parquet")
    content = io.BytesIO()
    # nodes hardly repeat, so dictionaries only cost time; zstd takes twice the time of snappy to save a
    # tenth; Parquet's own types hold all of the schema
    options = {
        "compression": "snappy",
        "use_dictionary": False,
        "store_schema": False,
        "write_statistics": ["recording"],
        "write_page_checksum": True,
    }
    with pq.ParquetWriter(content, batch.schema, **options) as file:
        file.write_table(pa.Table.from_batches([batch]))
        file.add_key_value_metadata({VERSION_KEY: f"{SCHEMA_VERSION}", "strand.input": unit.digest or ""})
    return content.getvalue()
