"""Small recordings for batches, and work that ends in other ways than strand's; processes import it."""

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
    """A folder of scenes of one view."""
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
    """The table without what two runs differ in."""
    return load_table(out).drop_columns(["seconds"])


def find_shards(out: Path) -> list[str]:
    """Shards, each of which is whole; files that are half written have other names."""
    found = list_shards(out)
    assert len(load_table(out)) >= len(found)
    return found


@dataclass(frozen=True)
class Deadly:
    """Work that ends its process at some recordings: at each of them so many times."""

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
    """Work on a disk that holds so many shards."""

    work: Work
    most: int

    def __call__(self, unit: Unit) -> ShardCounts:
        if len(list_shards(Path(self.work.out))) >= self.most:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), self.work.out)
        return self.work(unit)


def interrupt(unit: Unit) -> ShardCounts:
    """Work that is interrupted as by Ctrl-C in the driver's terminal, and is not meant to hear of it."""
    os.kill(os.getpid(), signal.SIGINT)
    return ShardCounts(1, 0)
