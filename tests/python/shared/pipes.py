"""Read named pipes where files are meant: python tests/python/shared/pipes.py FOLDER.

Readers run in a process of their own, as one that waits for a pipe in compiled code cannot be interrupted.
It prints a line of JSON for each: name, kind and text of the error.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import strand
from strand import config
from strand.batch import load_models, load_table, write_summary
from strand.batch.settings import DIGITS
from strand.batch.shards import read_root
from strand.io.intrinsics import read_intrinsics
from strand.io.models import load_frames
from strand.io.view_files import SUFFIXES

_BAG = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n  relative_file_paths:\n"


def load_folder(path: Path) -> object:
    return strand.load_scene(path.parent)


def record_folder(path: Path) -> object:
    return strand.Recording(path.parent)


def load_image(path: Path) -> object:
    return strand.load_scene(path, intrinsics=np.eye(3), depth_scale=0.001)


_IMAGES = (".png", ".tif", ".tiff")
_SHARD = f"table/aa/{'a' * DIGITS}-{'b' * DIGITS}-0-end.parquet"
READERS: list[tuple[str, Callable[[Path], Any]]] = [  # a file's name, and its reader
    *((f"a{suffix}", load_image if suffix in _IMAGES else strand.load_scene) for suffix in SUFFIXES),
    *((f"a{suffix}", strand.load_scene) for suffix in (".npz", ".toml")),
    *((f"a{suffix}", strand.Recording) for suffix in (".bag", ".mcap", ".db3")),
    ("scene/scene.toml", load_folder),
    ("bag/metadata.yaml", record_folder),
    ("other/b.db3", record_folder),
    ("a.json", strand.load_model),
    ("a.json", lambda path: list(load_frames(path))),
    ("a.json", read_intrinsics),
    ("a.txt", read_intrinsics),
    ("a.toml", config.load),
    (_SHARD, lambda path: load_table(path.parents[1])),
    (_SHARD, lambda path: list(load_models(path.parents[1]))),
    (_SHARD, lambda path: write_summary(path.parents[1], path.with_name("page.html"))),
    ("table/_root.json", lambda path: read_root(path.parent)),
]


def main(folder: Path) -> None:
    (folder / "other").mkdir()
    (folder / "other" / "metadata.yaml").write_text(f"{_BAG}    - b.db3\n")
    for name, read in READERS:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists():
            os.mkfifo(path)
        kind, text = "answer", ""
        try:
            read(path)
        except Exception as error:
            kind, text = type(error).__name__, str(error)
        print(json.dumps({"name": name, "kind": kind, "text": text}), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
