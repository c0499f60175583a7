"""Tricks with LeRobot data sets: small tables and videos that declare far more, and whole ones that fit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import strand
from lib.lerobot_files import (
    DATA,
    DEPTH,
    EPISODES,
    change_info,
    make_ramp,
    write_data_set,
    write_video,
)
from shared.tricks import MAX_BYTES, Trick

_K = np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]])
_ROWS = 3_000_000
_VIDEO = f"videos/{DEPTH}/chunk-000/file-000.mp4"
_LARGE = (2160, 3840)  # height and width of images
_IMAGE = 200_000_000  # bytes of an image of zeros


def list_tricks() -> list[Trick]:
    """Return the tricks with data sets."""
    makes: dict[str, Callable[[Path], Any]] = {
        "many rows": lambda folder: _make(folder, _fill_rows),
        "many episodes": lambda folder: _make(folder, _fill_episodes),
        "an image of zeros": lambda folder: _make(folder, _fill_image, "tiff"),
        "many samples": lambda folder: _make(folder, _declare_samples),
        "large images": lambda folder: _make(folder, _describe_large),
        "hidden large images": lambda folder: _make(folder, _hide_large),
    }
    bombs = [Trick(f"data set of {what}", make, _read, seconds=4.0) for what, make in makes.items()]
    fits = [
        Trick(
            f"data set of {kind}s", lambda folder, kind=kind: _make(folder, None, kind), _read, answered=True
        )
        for kind in ("video", "tiff")
    ]
    return [*bombs, *fits]


def _read(folder: Path) -> None:
    with strand.Recording(folder / "set", intrinsics=_K, max_bytes=MAX_BYTES) as recording:
        for _ in recording:
            pass


def _make(folder: Path, change: Callable[[Path], Any] | None, kind: str = "video") -> Path:
    made = write_data_set(folder / "set", make_ramp(4), (4,), kind)
    if change is not None:
        change(made)
    return made


def _fill_rows(folder: Path) -> None:
    index = np.arange(_ROWS) // 2
    table = pa.table({"index": index, "timestamp": np.zeros(_ROWS, np.float32)})
    pq.write_table(table, folder / DATA, compression="zstd")


def _fill_episodes(folder: Path) -> None:
    table = pq.read_table(folder / EPISODES)
    pq.write_table(table.take(np.zeros(_ROWS // 10, np.int64)), folder / EPISODES, compression="zstd")


def _fill_image(folder: Path) -> None:
    table = pq.read_table(folder / DATA)
    files = [{"bytes": bytes(_IMAGE), "path": "frame.tiff"}, *table[DEPTH].to_pylist()[1:]]
    column = pa.array(files, table[DEPTH].type)
    pq.write_table(table.drop_columns(DEPTH).append_column(DEPTH, column), folder / DATA, compression="zstd")


def _declare_samples(folder: Path) -> None:
    data = bytearray((folder / _VIDEO).read_bytes())
    at = data.index(b"stsz")
    data[at + 8 : at + 16] = (4).to_bytes(4, "big") + (1 << 30).to_bytes(4, "big")
    (folder / _VIDEO).write_bytes(data)


def _describe_large(folder: Path) -> None:
    change_info(folder, lambda content: content["features"][DEPTH].update(shape=[1 << 15, 1 << 15, 1]))


def _hide_large(folder: Path) -> None:
    """Write a video whose header has the size that `info.json` has, and whose stream is larger."""
    height, width = 48, 64
    write_video(
        folder / _VIDEO,
        [np.zeros(_LARGE, np.uint16)] * 4,
        "hevc",
        "gray12le",
        {"x265-params": "log-level=none"},
    )
    data = bytearray((folder / _VIDEO).read_bytes())
    at = data.index(b"hev1") + 28
    assert data[at : at + 4] == _LARGE[1].to_bytes(2, "big") + _LARGE[0].to_bytes(2, "big")
    data[at : at + 4] = width.to_bytes(2, "big") + height.to_bytes(2, "big")
    (folder / _VIDEO).write_bytes(data)
