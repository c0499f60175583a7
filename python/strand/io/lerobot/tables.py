"""Read the Parquet files of a data set within a memory limit."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.support.extras import import_extra
from strand.support.files import FileFormatError, open_file
from strand.support.pages import measure_footer, measure_rows

_NUMBERS = ("BOOLEAN", "INT32", "INT64", "FLOAT", "DOUBLE")  # Parquet's types of numbers
_NUMBER = 40  # bytes of a number while its column is read
_BUFFER = 1 << 20  # bytes that are read at once


class Table:
    """An open Parquet file; use `open_table`."""

    def __init__(self, path: Path, opened: BinaryIO, file: Any, budget: Budget) -> None:
        self.path, self.file, self.budget, self._opened = path, file, budget, opened
        schema = file.schema
        self._leaves = {schema.column(k).path: k for k in range(len(schema))}

    @property
    def rows(self) -> int:
        """The number of rows."""
        return int(self.file.metadata.num_rows)

    def read_numbers(self, names: Sequence[str]) -> dict[str, NDArray[Any]]:
        """Return columns of numbers; ValueError names a column that is missing or has no numbers."""
        for name in names:
            if name not in self._leaves:
                raise ValueError(f"no column {name}")
            if (kind := self.file.schema.column(self._leaves[name]).physical_type) not in _NUMBERS:
                raise ValueError(f"column {name}: expected numbers, got {kind}")
        with self.budget.hold(self.path, _NUMBER * self.rows * len(names)):
            for group in range(self.file.metadata.num_row_groups):
                self.hold_pages(group, names)
            table = self.file.read(columns=list(names), use_threads=False)
            found = {}
            for name in names:
                column = table[name]
                if column.null_count or len(column) != self.rows:
                    raise ValueError(f"column {name}: expected {self.rows} numbers, and none missing")
                found[name] = column.to_numpy()
            return found

    def hold_pages(self, group: int, names: Sequence[str], rows: int = 1) -> None:
        """Raise an error if pages of columns, and `rows` of them together, are too large for the budget."""
        places = [
            place
            for leaf, place in self._leaves.items()
            if any(f"{leaf}.".startswith(f"{n}.") for n in names)
        ]
        with self.budget.hold(self.path, measure_rows(self._opened, self.file.metadata, group, places, rows)):
            pass

    def read_rows(self, group: int, start: int, names: Sequence[str], size: int) -> Iterator[Any]:
        """Yield the rows of a group from row `start` on as record batches of at most `size` rows."""
        self.hold_pages(group, names, size)
        skipped = 0
        for batch in self.file.iter_batches(size, row_groups=[group], columns=list(names), use_threads=False):
            if skipped + len(batch) > start:
                yield batch.slice(max(start - skipped, 0))
            skipped += len(batch)


@contextmanager
def open_table(path: Path, budget: Budget) -> Iterator[Table]:
    """Open a Parquet file in a `with` statement, which converts all errors of damage to FileFormatError."""
    parquet = import_extra("pyarrow.parquet")
    with convert_errors(path), open_file(path) as opened:
        length, memory = measure_footer(opened, os.fstat(opened.fileno()).st_size)
        with budget.hold(path, memory):
            file = parquet.ParquetFile(
                opened,
                buffer_size=_BUFFER,
                pre_buffer=False,
                page_checksum_verification=True,
                thrift_container_size_limit=max(length, 1),
            )
            yield Table(path, opened, file, budget)


@contextmanager
def convert_errors(path: Path) -> Iterator[None]:
    """Convert the errors that damaged Parquet files cause to FileFormatError."""
    arrow = import_extra("pyarrow")
    try:
        yield
    except FileFormatError:
        raise
    except (arrow.ArrowException, KeyError, ValueError, OverflowError, OSError) as error:
        # errors of the disk have a number; those of pyarrow have none
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise FileFormatError(path, f"truncated, damaged or not a table of a data set ({error})") from error


def find_group(table: Table, row: int) -> tuple[int, int]:
    """Return the group of a row, and its place there."""
    sizes = [table.file.metadata.row_group(k).num_rows for k in range(table.file.metadata.num_row_groups)]
    ends = np.cumsum(sizes)
    group = int(np.searchsorted(ends, row, side="right"))
    return group, row - int(ends[group - 1] if group else 0)
