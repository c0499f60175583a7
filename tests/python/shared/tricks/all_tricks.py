"""All tricks, and the modules that readers load late."""

from __future__ import annotations

import importlib

from shared.tricks import (
    Trick,
    arrays,
    bag_files,
    clouds,
    data_sets,
    documents,
    images,
    mcap_files,
    messages,
    shards,
)

_LATE = (
    "PIL.BmpImagePlugin",
    "PIL.JpegImagePlugin",
    "PIL.PngImagePlugin",
    "PIL.PpmImagePlugin",
    "PIL.TiffImagePlugin",
    "av",
    "lz4.frame",
    "pyarrow.parquet",
    "backports.zstd",
    "strand.cli",
)


def load_modules() -> None:
    """Load the modules whose memory does not depend on a file."""
    for name in _LATE:
        importlib.import_module(name)


def list_tricks() -> list[Trick]:
    """Return all tricks."""
    rooms = (images, arrays, clouds, documents, mcap_files, messages, bag_files, shards, data_sets)
    return [trick for room in rooms for trick in room.list_tricks()]
