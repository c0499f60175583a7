"""The memory limit that the files of one scene share, and the bytes that decoders and views take."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from strand.support.files import FileFormatError, read_bytes

MAX_BYTES = 1 << 32  # default limit, bytes
VIEW_BYTES = 4096  # bytes of a view beside its arrays
MAX_HEADER = 1 << 16  # longest header of a point cloud, bytes
# a pixel of a view
_DEPTH = 8  # bytes of its depth (float64)
_MASK = 4  # bytes of its label (int32)
_OCCLUDERS = 1  # bytes of its occluder (bool)
_COLOR = 27  # bytes of its colour (three uint8, and three float64 of its point)
_IMAGES = {"mask": _MASK, "occluders": _OCCLUDERS, "color": _COLOR, "colors": _COLOR}
_FLOAT = 8  # bytes of a number of a point or its colour
_COPYING = 24  # bytes of a number while the view of a point cloud is made, beside the view itself
_MAKING = 16  # bytes of a pixel while its view is made, beside the view itself


class Budget:
    """The memory that is left for the files of a scene.

    Readers call `take` or `hold` with the size that a file declares, before they decode anything.
    """

    def __init__(self, max_bytes: int) -> None:
        self.max_bytes = self.left = max_bytes

    def copy(self) -> Budget:
        """Return a budget of its own with what is left of this one."""
        other = Budget(self.max_bytes)
        other.left = self.left
        return other

    def take(self, file: str | os.PathLike[str], size: int, place: str | None = None) -> None:
        """Reserve `size` bytes for data of a file; raise FileFormatError if less is left."""
        if size > self.left:
            raise FileFormatError(
                file, f"takes {size} bytes, but {self.left} are left of max_bytes={self.max_bytes}", place
            )
        self.left -= size

    @contextmanager
    def hold(self, file: str | os.PathLike[str], size: int, place: str | None = None) -> Iterator[None]:
        """Reserve `size` bytes inside a `with` statement."""
        self.take(file, size, place)
        try:
            yield
        finally:
            self.left += size

    def read(self, file: Path) -> bytes:
        """Return the bytes of a regular file, and reserve them; refuse an empty file."""
        data = read_bytes(file, self.left)
        if not data:
            raise FileFormatError(file, "the file is empty")
        self.take(file, len(data))
        return data

    @contextmanager
    def hold_view(
        self, file: str | os.PathLike[str], pixels: int, views: int = 1, place: str | None = None
    ) -> Iterator[None]:
        """Reserve the depths of views of `pixels` pixels, and what it takes to make one after another."""
        self.take(file, views * (VIEW_BYTES + _DEPTH * pixels), place)
        with self.hold(file, _MAKING * pixels, place):
            yield

    @contextmanager
    def hold_cloud(self, file: str | os.PathLike[str], numbers: int) -> Iterator[None]:
        """Reserve a view of points with so many floats, and what it takes to make it."""
        self.take(file, VIEW_BYTES + _FLOAT * numbers)
        with self.hold(file, _COPYING * numbers):
            yield

    def take_image(self, file: str | os.PathLike[str], key: str, pixels: int) -> None:
        """Reserve an image of a view's key, such as "mask", with as many pixels as the view."""
        self.take(file, _IMAGES[key] * pixels, key)
