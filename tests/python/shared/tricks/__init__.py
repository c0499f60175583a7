"""Files that ask a reader for far more memory or time than they take on a disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from strand.support.files import FileFormatError

MAX_BYTES = 1 << 24  # the limit that readers of these files get, bytes
MOST = (64 << 20) + 2 * MAX_BYTES  # memory that a reader may take, bytes


@dataclass(frozen=True)
class Trick:
    """A file, and the reader that it attacks.

    Attributes
    ----------
    name : str
    make : callable
        Writes the file, and others that the reader needs, into a folder.
    read : callable
        Reads the file in a folder, with `MAX_BYTES` as the limit.
    answered : bool
        Whether the file is read; else FileFormatError is expected.
    seconds : float
        The most processor time; by default, only a limit of the process ends the reader.
    most : int
        The most memory, bytes.
    """

    name: str
    make: Callable[[Path], Any]
    read: Callable[[Path], Any]
    answered: bool = False
    seconds: float = 60.0
    most: int = MOST


def try_files(
    name: str,
    makes: Mapping[str, Callable[[], bytes]],
    file: str,
    read: Callable[[Path], Any],
    answered: bool = False,
    seconds: float = 60.0,
    most: int = MOST,
) -> Trick:
    """Return a trick with several files of one name, which are read one after the other.

    `makes` returns their bytes by what they are. All of them are to be read, or all are to be refused.
    """

    def write(folder: Path) -> None:
        for i, make in enumerate(makes.values()):
            (folder / str(i)).mkdir()
            (folder / str(i) / file).write_bytes(make())

    def read_all(folder: Path) -> None:
        refused = None
        for i, what in enumerate(makes):
            try:
                read(folder / str(i) / file)
                assert answered, what
            except FileFormatError as error:
                refused = str(error)
        if refused is not None:
            raise FileFormatError(folder, refused)

    return Trick(name, write, read_all, answered, seconds, most)
