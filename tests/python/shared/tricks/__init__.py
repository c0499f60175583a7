"""Files that ask a reader for far more memory or time than they take on a disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MAX_BYTES = 1 << 24  # the limit that readers of these files get, bytes


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
    """

    name: str
    make: Callable[[Path], Any]
    read: Callable[[Path], Any]
    answered: bool = False
    seconds: float = 60.0
