"""How much memory a scene's files may take."""

from __future__ import annotations

import os
from pathlib import Path

from strand.support.files import FileFormatError, read_bytes

MAX_BYTES = 1 << 32


class Budget:
    """What is left of a limit that the files of a scene share.

    It is asked before something is decoded, by the size that the file declares.

    Parameters
    ----------
    max_bytes : int
        How many bytes they may take together.
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = self.left = max_bytes

    def take(self, file: str | os.PathLike[str], size: int, place: str | None = None) -> None:
        """Set bytes aside for something in a file.

        Raises
        ------
        strand.FileFormatError
            If so many are not left.
        """
        if size > self.left:
            raise FileFormatError(
                file, f"takes {size} bytes, but {self.left} are left of max_bytes={self.max_bytes}", place
            )
        self.left -= size

    def read(self, file: Path) -> bytes:
        """Return what a file holds, which must be something.

        Raises
        ------
        strand.FileFormatError
            If it is empty, no regular file, or takes more than is left.
        OSError
            If it is missing, or cannot be read.
        """
        data = read_bytes(file, self.left)
        if not data:
            raise FileFormatError(file, "the file is empty")
        self.take(file, len(data))
        return data
