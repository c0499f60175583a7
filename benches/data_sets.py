"""Measure LeRobot data sets of 500 frames: times, and errors of ropes by 12-bit video and by exact images.

python benches/data_sets.py [--frames 100] [--repeats 5] [--every 10]

Five sequences of one camera are the episodes; each of their frames is written `--repeats` times. The truth is
known. Times are processor times. The last column is the time for pandas to read the new data set's ropes.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd

from lib.lerobot_files import DATA, write_data_set
from lib.results import make_parser, run_bench
from lib.tables import print_head, print_row
from strand import NotEnoughDataError, Recording, reconstruct
from strand.batch import write_lerobot
from strand.synthetic import sequence

KINDS = ("carry", "loop", "two", "still", "slide")


def refine(nodes: np.ndarray) -> np.ndarray:
    """Return points at a twentieth of the nodes' distances."""
    fine = np.linspace(0, len(nodes) - 1, 20 * (len(nodes) - 1) + 1)
    return np.stack([np.interp(fine, np.arange(len(nodes)), axis) for axis in nodes.T], axis=1)


def measure_set(folder: Path, kind: str, frames: list, every: int) -> tuple:
    """Read, reconstruct and write a data set; return the columns of its row."""
    given, spent, models, errors = {"intrinsics": frames[0].intrinsics}, [], [], []

    def end() -> None:
        spent.append(time.process_time() - spent.pop())

    spent.append(time.process_time())
    with Recording(folder, **given) as recording:
        read = sum(1 for _ in recording)
    end()
    with Recording(folder, **given) as recording:
        spent.append(time.process_time())
        taken = sum(1 for _ in recording.read(0, None, every))
        end()
        spent.append(time.process_time())
        for episode in recording.episodes:
            previous = None
            for frame in recording.read(episode.start, episode.stop, every):
                try:
                    previous = reconstruct(frame.views, previous=previous)
                except NotEnoughDataError:
                    continue
                models.append((frame.number, previous))
        end()
    for number, model in models:
        pose = frames[number].poses[0]
        truth = np.concatenate([refine(nodes) for nodes in frames[number].nodes])
        truth = (truth - pose[:3, 3]) @ pose[:3, :3]
        for chain in model.chains:
            gaps = np.linalg.norm(chain.points[:, None] - truth[None], axis=2)
            errors.append(gaps.min(axis=1))
    spent.append(time.process_time())
    write_lerobot(models, folder, folder.with_name("new"))
    end()
    spent.append(time.process_time())
    rows = pd.read_parquet(folder.with_name("new") / DATA)
    assert sum(rows.filter(regex=r"rope0?\.valid$").iloc[:, 0]) == len(models)
    end()
    away = 1e3 * np.concatenate(errors)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return (
        kind,
        read,
        f"{size / 1e6:.0f}",
        f"{1e3 * spent[0] / read:.1f}",
        f"{1e3 * spent[1] / taken:.1f}",
        f"{len(models)} of {taken}",
        f"{1e3 * (spent[2] - spent[1]) / max(len(models), 1):.0f}",
        f"{np.sqrt((away**2).mean()):.2f}",
        f"{np.quantile(away, 0.95):.2f}",
        f"{np.median([model.confidence for _, model in models]):.2f}",
        f"{spent[3]:.2f}",
        f"{spent[4]:.2f}",
    )


def main() -> int:
    parser = make_parser(__doc__)
    parser.add_argument("--frames", type=int, default=100, help="frames that are drawn")
    parser.add_argument("--repeats", type=int, default=5, help="times that each is written")
    parser.add_argument("--every", type=int, default=10, help="frames between two that are reconstructed")
    arguments = parser.parse_args()
    count = arguments.frames // len(KINDS)
    frames = [
        frame
        for seed, kind in enumerate(KINDS, start=1)
        for frame in sequence(kind, seed, frames=count)
        for _ in range(arguments.repeats)
    ]
    depth = np.stack([frame.depth[0].astype(np.float32) * np.float32(frame.depth_scale) for frame in frames])
    print_head(
        *("depth", "frames", "MB", "ms to read", "ms of every Nth", "answers", "ms to reconstruct"),
        *("error / mm", "95 % / mm", "confidence", "s to write", "s in pandas"),
    )
    for kind in ("video", "tiff"):
        with tempfile.TemporaryDirectory() as folder:
            made = write_data_set(Path(folder) / "set", depth, [count * arguments.repeats] * len(KINDS), kind)
            print_row(*measure_set(made, kind, frames, arguments.every))
    return 0


if __name__ == "__main__":
    run_bench(main)
