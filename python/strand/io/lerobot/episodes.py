"""The episodes of a data set: their frames, and the files that hold these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from strand.io.budget import Budget
from strand.io.lerobot.layout import EPISODES, Layout
from strand.io.lerobot.tables import open_table
from strand.support.files import FileFormatError

_RANGE = ("episode_index", "length", "dataset_from_index", "dataset_to_index")
_DATA = ("data/chunk_index", "data/file_index")
_VIDEO = ("chunk_index", "file_index", "from_timestamp")
_MAX_FILES = 100_000  # of episodes
_MAX_INDEX = 10**9  # number of a file, and of frames


@dataclass(frozen=True, eq=False)
class Episodes:
    """The episodes of a data set.

    Attributes
    ----------
    ranges : tuple of range
        The frames of each, by their `index` in the data set.
    columns : dict of str to (E,) ndarray
        The numbers of their files, and the times in these.
    """

    ranges: tuple[range, ...]
    columns: dict[str, NDArray[Any]]

    @property
    def count(self) -> int:
        """The number of frames."""
        return self.ranges[-1].stop if self.ranges else 0

    def find(self, frame: int) -> int:
        """Return the episode of a frame."""
        return int(np.searchsorted([each.stop for each in self.ranges], frame, side="right"))

    def get_data(self, episode: int) -> tuple[int, int]:
        """Return the chunk and file of an episode's table."""
        return int(self.columns[_DATA[0]][episode]), int(self.columns[_DATA[1]][episode])

    def get_video(self, episode: int, key: str) -> tuple[int, int, float]:
        """Return the chunk and file of an episode's video, and the time in it at which the episode begins."""
        chunk, file, begun = (self.columns[f"videos/{key}/{name}"][episode] for name in _VIDEO)
        return int(chunk), int(file), float(begun)


def list_episode_files(folder: Path) -> list[Path]:
    """Return the tables of episodes in their order."""
    found = sorted((folder / EPISODES).glob("chunk-*/file-*.parquet"))
    if not found or len(found) > _MAX_FILES:
        reason = f"expected 1 to {_MAX_FILES} tables chunk-000/file-000.parquet, got {len(found)}"
        raise FileFormatError(folder / EPISODES, reason)
    return found


def read_episodes(layout: Layout, keys: Sequence[str], budget: Budget) -> Episodes:
    """Return the episodes, with the files of some cameras' videos; FileFormatError if frames are missing."""
    names = [*_RANGE, *_DATA, *(f"videos/{key}/{name}" for key in keys for name in _VIDEO)]
    parts = []
    for path in list_episode_files(layout.folder):
        with open_table(path, budget) as table:
            parts.append(table.read_numbers(names))
            budget.take(path, 8 * table.rows * len(names))
    columns = {name: np.concatenate([part[name] for part in parts]) for name in names}
    folder = layout.folder / EPISODES
    for name, values in columns.items():
        time = name.endswith("_timestamp")
        if not time and values.dtype.kind not in "iu":
            raise FileFormatError(folder, f"expected whole numbers, got {values.dtype}", name)
        if len(values) and not (values.min() >= 0 and values.max() <= _MAX_INDEX):
            raise FileFormatError(folder, f"expected numbers from 0 to {_MAX_INDEX}", name)
    index, length, first, last = (columns[name].astype(np.int64) for name in _RANGE)
    whole = (
        np.array_equal(index, np.arange(len(index)))
        and np.array_equal(first, np.concatenate([[0], last])[: len(first)])
        and np.array_equal(last - first, length)
    )
    if not whole:
        reason = "expected the episodes from 0 on, each with the frames after those of the one before"
        raise FileFormatError(folder, reason)
    if not length.all() or not len(length):
        raise FileFormatError(
            folder, "expected episodes with frames, got " + ("one without" if len(length) else "none")
        )
    return Episodes(tuple(map(range, first.tolist(), last.tolist())), columns)
