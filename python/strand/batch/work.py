"""The work that every engine does, in any process: make the shard of a unit."""

from __future__ import annotations

import io
import multiprocessing
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from strand._core import __version__
from strand.batch.engines import EngineError
from strand.batch.rows import iterate_rows, make_error_row
from strand.batch.settings import Settings
from strand.batch.shards import SUFFIX, is_unreadable, make_recording_key, name_shard
from strand.batch.table import Row
from strand.batch.units import Unit
from strand.batch.writing import write_rows
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
        content, counts = self._encode(unit, iterate_rows(unit, self.settings))
        if is_orphaned():
            # the next run may have started already, with other settings
            raise SystemExit
        return self._write(unit, content, counts)

    def give_up(self, unit: Unit, error: str) -> ShardCounts:
        """Write the error row of a unit on which every process dies."""
        return self._write(unit, *self._encode(unit, [make_error_row(unit, error)]))

    def _encode(self, unit: Unit, rows: Iterable[Row]) -> tuple[bytes, ShardCounts]:
        content = io.BytesIO()
        counts = write_rows(rows, content, self.settings.digest, unit.digest)
        return content.getvalue(), ShardCounts(*counts)

    def _write(self, unit: Unit, content: bytes, counts: ShardCounts) -> ShardCounts:
        good, failed = (
            Path(self.out, name_shard(unit, self.settings.digest, with_errors))
            for with_errors in (False, True)
        )
        if counts.errors and (good.exists() or self._has_rows(unit)):
            # by a worker that died before it could answer, or by another run
            return ShardCounts(0, 0)
        good.parent.mkdir(exist_ok=True)
        # shards are the batch's own: a copy of the folder made of hard links keeps the earlier one
        write_bytes(failed if counts.errors else good, content, links=True)
        if not counts.errors:
            failed.unlink(missing_ok=True)
        return counts

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
