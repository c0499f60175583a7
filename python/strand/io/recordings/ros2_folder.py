"""Find the files of a ROS 2 bag, which is a folder with a metadata.yaml."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from strand.support.files import FileFormatError, read_bytes

METADATA = "metadata.yaml"  # the file that makes a folder a ROS 2 bag
YAML_BYTES = 1 << 18  # largest metadata.yaml, bytes
_PACKED = ".zstd"  # suffix of files that are compressed as a whole
# rosbag2 writes one path a line; to parse YAML of strangers takes much memory and time
_PATHS = re.compile(r"^[ \t]*relative_file_paths:[ \t]*\n((?:[ \t]*-[ \t][^\n]*(?:\n|\Z))+)", re.MULTILINE)


def list_storage(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return the files with the messages of a bag, in the order of recording."""
    metadata = folder / METADATA
    text = read_bytes(metadata, YAML_BYTES).decode(errors="replace").replace("\r\n", "\n")
    found = _PATHS.search(text)
    if found is None:
        raise FileFormatError(metadata, "expected relative_file_paths with one path a line")
    lines = (line.strip()[1:].strip().strip("\"'") for line in found[1].splitlines())
    paths = [folder / PurePosixPath(line).name for line in dict.fromkeys(lines)]
    for path in paths:
        if path.suffix == _PACKED:
            reason = "the file is compressed as a whole; decompress it first (compressed chunks are fine)"
            raise FileFormatError(path, reason)
        if path.suffix not in suffixes:
            raise FileFormatError(
                metadata, f"expected files of messages ({', '.join(suffixes)}), got {path.name[:80]!r}"
            )
    return paths
