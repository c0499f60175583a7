"""Small recordings for batches, and work that fails; the engines' processes import this module."""

from __future__ import annotations

import errno
import os
import signal
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa

import strand
from strand.batch import Settings, Unit, load_table
from strand.batch.shards import list_shards
from strand.batch.work import ShardCounts, Work
from strand.synthetic import SHAPES

SETTINGS = Settings(ropes=1)
COUNT = 18  # recordings of the fixture `recordings`


def save_scenes(folder: Path, count: int) -> Path:
    """Fill a folder with scenes of one view."""
    for seed in range(count):
        name = SHAPES[seed % 6]
        made = strand.synthetic.scene(
            name,
            views=1,
            camera=strand.synthetic.Camera(size=(160, 120)),
            seed=seed,
            noise=strand.synthetic.Noise(flying=0.0),
        )
        (folder / f"{seed % 3}").mkdir(parents=True, exist_ok=True)
        made.save(folder / f"{seed % 3}" / f"{seed:02}.npz")
    return folder


def read_table(out: Path) -> pa.Table:
    """Return the table without the column in which two runs differ."""
    return load_table(out).drop_columns(["seconds"])


def find_shards(out: Path) -> list[str]:
    """Return the names of the shards, each of which can be read."""
    found = list_shards(out)
    assert len(load_table(out)) >= len(found)
    return found


@dataclass(frozen=True)
class Deadly:
    """Work that kills its process at some recordings, `times` times each."""

    work: Work
    recordings: tuple[str, ...]
    times: int
    notes: str

    def __call__(self, unit: Unit) -> ShardCounts:
        if unit.recording in self.recordings:
            note = Path(self.notes, unit.recording.replace("/", "-"))
            deaths = len(note.read_bytes()) if note.exists() else 0
            if deaths < self.times:
                note.write_bytes(b"x" * (deaths + 1))
                os.kill(os.getpid(), signal.SIGKILL)
        return self.work(unit)


@dataclass(frozen=True)
class FullDisk:
    """Work on a disk that holds `most` shards."""

    work: Work
    most: int

    def __call__(self, unit: Unit) -> ShardCounts:
        if len(list_shards(Path(self.work.out))) >= self.most:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self.work.out)
        return self.work(unit)


def interrupt(unit: Unit) -> ShardCounts:
    """Work that sends itself the signal of Ctrl-C, which workers ignore."""
    os.kill(os.getpid(), signal.SIGINT)
    return ShardCounts(1, 0)
