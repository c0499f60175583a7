"""The memory limit that the files of one scene share."""

from __future__ import annotations

import os
from pathlib import Path

from strand.support.files import FileFormatError, read_bytes

MAX_BYTES = 1 << 32  # default limit, bytes
VIEW_BYTES = 4096  # bytes of a view beside its arrays
MAX_HEADER = 1 << 16  # longest header of a point cloud, bytes


class Budget:
    """The memory that is left for the files of a scene.

    Readers call `take` with the size that a file declares, before they decode anything.
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = self.left = max_bytes

    def take(self, file: str | os.PathLike[str], size: int, place: str | None = None) -> None:
        """Reserve `size` bytes for data of a file; raise FileFormatError if less is left."""
        if size > self.left:
            raise FileFormatError(
                file, f"takes {size} bytes, but {self.left} are left of max_bytes={self.max_bytes}", place
            )
        self.left -= size

    def read(self, file: Path) -> bytes:
        """Return the bytes of a regular file, and reserve them; refuse an empty file."""
        data = read_bytes(file, self.left)
        if not data:
            raise FileFormatError(file, "the file is empty")
        self.take(file, len(data))
        return data
