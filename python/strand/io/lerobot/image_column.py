"""Read the image files in a column of a data set's table, one in memory at a time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from strand.io.budget import Budget
from strand.io.lerobot.tables import convert_errors, find_group, open_table
from strand.support.files import FileFormatError


class ImageColumn:
    """A column of image files; `close` it.

    Rows in order are read once; an earlier row begins its group of rows anew.

    Parameters
    ----------
    path : Path
        The table.
    key : str
    budget : Budget
    """

    def __init__(self, path: Path, key: str, budget: Budget) -> None:
        self.path, self._key = path, key
        self._stack = ExitStack()
        self._table = self._stack.enter_context(open_table(path, budget))
        self._next: tuple[int, int] | None = None
        self._batches: Iterator[Any] = iter(())

    def close(self) -> None:
        """Close the table."""
        self._batches = iter(())
        self._stack.close()

    def read(self, row: int) -> bytes:
        """Return the image file of a row of the table."""
        with convert_errors(self.path):
            group, place = find_group(self._table, row)
            if self._next is None or self._next[0] != group or self._next[1] > place:
                self._batches = self._table.read_rows(group, place, [f"{self._key}.bytes"], 1)
                self._next = (group, place)
            batch = None
            while self._next[1] <= place:
                batch = next(self._batches, None)
                if batch is None:
                    raise ValueError(f"no row {row}")
                self._next = (group, self._next[1] + 1)
            assert batch is not None
            value = batch.column(0)[0].as_py()
            data = value.get("bytes") if isinstance(value, dict) else value
        if not isinstance(data, bytes) or not data:
            raise FileFormatError(
                self.path, f"expected the bytes of an image in row {row}, got none", self._key
            )
        return data
