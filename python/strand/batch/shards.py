"""Shards: one Parquet file per unit. Their names hold their state, so that a listing tells what is there."""

from __future__ import annotations

import errno
import os
import re
import time
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

from strand._core import __version__
from strand.batch.settings import DIGITS, Settings, compute_digest
from strand.batch.table import SCHEMA_VERSION
from strand.batch.units import Unit
from strand.support.files import FileFormatError, read_json, write_json

SUFFIX = ".parquet"
"""Suffix of a shard's name."""

_FAILED_SUFFIX = "-errors" + SUFFIX
_ROOT_FILE = "_root.json"  # readers of data sets skip names that begin with an underscore
_NAME = re.compile(rf"[0-9a-f]{{{DIGITS}}}-[0-9a-f]{{{DIGITS}}}-(\d+)-(\d+|end)(-errors)?\.parquet")
_UNREADABLE_STATE = "0" * (DIGITS // 2)  # beginning of the state of a recording that cannot be read
_MAX_AGE = 3600.0  # seconds: older half-written files are removed; writing one takes a fraction of a second


def make_recording_key(recording: str) -> str:
    """Return the beginning of the names of a recording's shards."""
    digest = compute_digest(recording)
    return f"{digest[:2]}/{digest}-"


def make_state_key(unit: Unit, configuration: str) -> str:
    """Return the beginning of the names of shards with this recording, input, configuration and version."""
    state = compute_digest(f"{unit.digest or ''}\n{configuration}\n{__version__}\n{SCHEMA_VERSION}")
    if unit.digest is None:
        state = _UNREADABLE_STATE + state[len(_UNREADABLE_STATE) :]
    return f"{make_recording_key(unit.recording)}{state}-"


def name_shard(unit: Unit, configuration: str, failed: bool) -> str:
    """Return the name of a unit's shard below the folder of shards; `failed` shards hold errors."""
    stop = "end" if unit.stop is None else unit.stop
    suffix = _FAILED_SUFFIX if failed else SUFFIX
    return f"{make_state_key(unit, configuration)}{unit.start}-{stop}{suffix}"


def is_unreadable(name: str) -> bool:
    """Tell whether a shard of this name says only that its recording cannot be read."""
    return name.split("-")[1].startswith(_UNREADABLE_STATE)


class Shards:
    """The shards that a folder held when this object was made, without those that it removed.

    Parameters
    ----------
    out : path-like
        The folder, which exists.

    Attributes
    ----------
    out : Path
    names : list of str
        In alphabetical order.
    """

    def __init__(self, out: str | os.PathLike[str]) -> None:
        self.out = Path(out)
        self.names = sorted(list_shards(self.out))

    def find(self, unit: Unit, configuration: str) -> str | None:
        """Return the name of the shard with a unit's rows, of the same input, configuration and version.

        A recording that could not be opened during the search is a single unit. If the folder holds all of
        its stretches, the method returns the first of these.
        """
        key = make_state_key(unit, configuration)
        current = [name for name in self._list(unit.recording) if name.startswith(key)]
        for failed in (False, True):
            if (name := name_shard(unit, configuration, failed)) in current:
                return name
        return current[0] if unit.whole and _are_complete(current) else None

    def must_keep(self, unit: Unit) -> bool:
        """Tell whether the recording cannot be read now, but has earlier rows."""
        return unit.digest is None and any(not is_unreadable(name) for name in self._list(unit.recording))

    def remove_unreadable(self, recording: str) -> int:
        """Remove shards which say that this recording or folder cannot be read; return their number."""
        return self._remove([name for name in self._list(recording) if is_unreadable(name)])

    def remove_stale(self, unit: Unit, configuration: str) -> int:
        """Remove outdated shards of a unit's recording, and return their number.

        Outdated shards are:

        - those of another input, configuration or version;
        - errors of a unit that succeeded since;
        - the shard of the whole recording, if the recording is now split into stretches.

        The batch calls this before it writes new shards, so that no row exists twice.
        """
        current, kept = make_state_key(unit, configuration), self.find(unit, configuration)
        stale = set()
        if not unit.whole:
            whole = replace(unit, start=0, stop=None)
            stale = {name_shard(whole, configuration, failed) for failed in (False, True)}
        if kept is not None and not kept.endswith(_FAILED_SUFFIX):
            stale.add(name_shard(unit, configuration, True))
        return self._remove(
            [name for name in self._list(unit.recording) if not name.startswith(current) or name in stale]
        )

    def _remove(self, gone: Sequence[str]) -> int:
        for name in gone:
            del self.names[bisect_left(self.names, name)]
            with suppress(FileNotFoundError):
                (self.out / name).unlink()
        return len(gone)

    def _list(self, recording: str) -> Sequence[str]:
        key = make_recording_key(recording)
        first = last = bisect_left(self.names, key)
        while last < len(self.names) and self.names[last].startswith(key):
            last += 1
        return self.names[first:last]


def _are_complete(names: Sequence[str]) -> bool:
    """Tell whether stretches of one state follow each other from the first frame to the end."""
    matches = (_NAME.fullmatch(name.rpartition("/")[2]) for name in names)
    stops = {match[1]: match[2] for match in matches if match}
    frame = "0"
    while frame in stops:
        frame = stops[frame]
    return frame == "end"


def list_shards(out: Path) -> list[str]:
    """Return the names of all shards below a folder of shards, unsorted; skip other files."""
    found = []
    with os.scandir(out) as folders:
        inner = [entry for entry in folders if len(entry.name) == 2 and entry.is_dir()]
    for folder in inner:
        with os.scandir(folder.path) as entries:
            found += [f"{folder.name}/{entry.name}" for entry in entries if _NAME.fullmatch(entry.name)]
    return found


def read_root(out: Path) -> Path:
    """Return the folder to which a folder of shards relates names; for new shards, the current folder.

    Raises
    ------
    ValueError
        If that folder does not exist.
    strand.FileFormatError
        If the file that holds it is damaged.
    """
    file = out / _ROOT_FILE
    if not file.exists():
        return Path.cwd()
    root = read_json(file)
    if not isinstance(root, str):
        raise FileFormatError(file, "expected the path of a folder")
    if not os.path.isdir(root):
        raise ValueError(
            f"root: {out} names recordings relative to {root}, which is not a folder here; "
            "give its present path (root=, --root)"
        )
    return Path(root)


def find_root(out: Path) -> Path | None:
    """Return the folder to which a folder of shards relates names; None if it is unknown or gone."""
    with suppress(OSError, ValueError):
        return read_root(out) if (out / _ROOT_FILE).exists() else None
    return None


def prepare_folder(out: Path, settings: Settings, root: Path) -> None:
    """Make the folder of shards, with files that hold its root and the settings.

    Also remove the half-written files that killed processes left more than an hour ago.
    """
    out.mkdir(parents=True, exist_ok=True)
    configuration = out / f"_configuration-{settings.digest}.json"
    if not configuration.exists():
        with _ignore_read_only():
            write_json(configuration, settings.to_json())
    _write_root(out / _ROOT_FILE, os.path.abspath(root))
    oldest = time.time() - _MAX_AGE
    for file in (*out.glob(".strand-*.tmp"), *out.glob("*/.strand-*.tmp")):
        with suppress(FileNotFoundError), _ignore_read_only():
            if file.stat().st_mtime < oldest:
                file.unlink()


def _write_root(file: Path, root: str) -> None:
    """Write the root, unless the file holds it already."""
    with suppress(FileFormatError, FileNotFoundError):
        if read_json(file) == root:
            return
    with _ignore_read_only():
        write_json(file, root, links=True)


@contextmanager
def _ignore_read_only() -> Iterator[None]:
    """Ignore that the folder is read-only: it may be complete; if not, writing a shard fails."""
    try:
        yield
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
