"""Units of work: recordings, or stretches of them, found in files and folders and opened by whoever works."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from strand.batch.settings import Settings, digest_of
from strand.io.recordings import Recording, is_recording
from strand.io.recordings.bags import METADATA, SUFFIXES
from strand.io.view_files import SUFFIXES as SINGLE
from strand.support.checks import check_path, check_sequence
from strand.support.files import FileFormatError, open_file

SCENE, BAG, IMAGES = "scene", "bag", "images"
"""What kinds of recording there are: `strand.load_scene` reads it; `strand.Recording` does; depth images."""

DEPTH_IMAGES = (".png", ".tif", ".tiff")
"""What a folder of depth images is known by."""

_DESCRIPTION = "scene.toml"
# how a bag's metadata begins, and in how many bytes
_OF_BAGS, _BEGINNING = b"rosbag2_bagfile_information", 4096


@dataclass(frozen=True)
class Unit:
    """A recording, or a stretch of it: all that a worker needs to open it.

    Attributes
    ----------
    recording : str
        What the rows call it: its path below the root, or its whole path if it is elsewhere.
    path : str
        Where it is.
    kind : str
        `SCENE`, `BAG` or `IMAGES`.
    digest : str or None
        Of the names below it, sizes and times of modification of its files; None: they cannot be read.
    start : int
        The first frame.
    stop : int or None
        The frame before which it ends; None: it goes to the end.
    error : str or None
        Why it cannot be read, if that is known already: what its row says.
    """

    recording: str
    path: str
    kind: str
    digest: str | None
    start: int = 0
    stop: int | None = None
    error: str | None = None

    @property
    def whole(self) -> bool:
        """Whether it is all of the recording."""
        return self.start == 0 and self.stop is None


def find(
    given: Sequence[str | os.PathLike[str]],
    settings: Settings,
    root: str | os.PathLike[str],
    leave_out: str | os.PathLike[str] | None = None,
) -> Iterator[Unit]:
    """Go through the units of files and folders, in the order of their names; each comes once.

    A walk passes over links to folders and files of one view. Those that are named below a folder that is
    named too come last.

    Parameters
    ----------
    given : sequence of paths
        Recordings, and folders in which they are sought.
    settings : Settings
        How they are read.
    root : path
        The folder below which recordings are named.
    leave_out : path, optional
        A folder that is not searched: that of the table.

    Raises
    ------
    FileNotFoundError
        If a path does not exist, before anything is found.
    TypeError
        If there is something else than paths, or one path in place of several.
    ValueError
        If a path is empty, or there is no recording in one of them; before anything is found.
    """
    kept = None if leave_out is None else os.path.realpath(check_path("leave_out", leave_out))
    named = {os.path.abspath(check_path("given", one)) for one in check_sequence("given", given, "paths")}
    # several paths may lead to the same recordings: one of them is taken, and no link if there is another
    real = {one: os.path.realpath(one) for one in named}
    places = sorted(
        {real[one]: one for one in sorted(named, key=lambda one: (one == real[one], one))}.values()
    )
    above = check_path("root", root)
    for place in places:
        os.stat(place)
    for place in places:
        if next(_found(place, kept), None) is None:
            left = ""
            if kept is not None and Path(kept).is_relative_to(os.path.realpath(place)):
                left = (
                    f"; {kept} is the folder of the table (-o) and is not searched, so give it another place"
                )
            raise ValueError(
                f"recordings: {place} holds none: no folder with a {_DESCRIPTION}, {METADATA} or depth "
                f"images, and no .npz, {', '.join(SUFFIXES)} file{left}"
            )
    for place, kind in _once(places, kept):
        name = _name(place, above)
        try:
            unit = Unit(name, place, kind, _input_digest(place, kind, kept))
        except OSError as error:
            yield Unit(name, place, kind, None, error=in_words(error))
        else:
            yield from _stretches(unit, settings)


def _once(places: Sequence[str], leave_out: str | None) -> Iterator[tuple[str, str]]:
    """Go through what is found at paths, once where one of them is inside of another."""
    given = set(places)
    inside = {place for place in places if any(str(above) in given for above in Path(place).parents)}
    twice: set[str] = set()
    # a walk passes over files of one view and links, which are taken if they are named
    for place in sorted(places, key=lambda place: place in inside):
        for path, kind in _found(place, leave_out):
            if path in twice:
                continue
            if inside and any(str(above) in inside for above in (path, *Path(path).parents)):
                twice.add(path)
            yield path, kind


def _found(place: str, leave_out: str | None) -> Iterator[tuple[str, str]]:
    """Go through the paths of recordings at or below a path, with their kinds."""
    if not os.path.isdir(place):
        suffix = os.path.splitext(place)[1].lower()
        if suffix in SUFFIXES:
            yield place, BAG
        elif suffix in (".npz", ".toml", *SINGLE):
            yield place, SCENE
        return
    # a list instead of calls within calls, of which Python allows a thousand; the next one is its last
    ahead: list[tuple[str, str | None]] = [(place, None)]
    while ahead:
        path, kind = ahead.pop()
        if kind is not None:
            yield path, kind
        elif leave_out is None or os.path.realpath(path) != leave_out:
            ahead += reversed(_inside(path))


def _inside(folder: str) -> list[tuple[str, str | None]]:
    """Return the paths of a folder's recordings with their kinds, and of folders to go through without."""
    try:
        with os.scandir(folder) as listed:
            entries = sorted(listed, key=lambda entry: entry.name)
    except OSError:
        # who opens it says why it cannot be read
        return [(folder, SCENE)]
    names = {entry.name for entry in entries}
    if METADATA in names and _is_bag(folder, names):
        return [(folder, BAG)]
    if _DESCRIPTION in names:
        return [(folder, SCENE)]
    found: list[tuple[str, str | None]] = []
    if any(name.lower().endswith(DEPTH_IMAGES) for name in names):
        found.append((folder, IMAGES))
    for entry in entries:
        if entry.is_dir(follow_symlinks=False):
            found.append((entry.path, None))
        elif entry.name.lower().endswith(".npz"):
            found.append((entry.path, SCENE))
        elif is_recording(entry.path):
            found.append((entry.path, BAG))
    return found


def _is_bag(folder: str, names: set[str]) -> bool:
    """Tell whether metadata is that of a bag, or of a damaged one, and not a whole data set's."""
    if any(name.endswith(".db3") for name in names):
        return True
    with suppress(OSError, FileFormatError), open_file(os.path.join(folder, METADATA)) as file:
        return _OF_BAGS in file.read(_BEGINNING)
    return False


def images_of(folder: str) -> list[str]:
    """Return the paths of a folder's depth images in the order of their names."""
    return [
        os.path.join(folder, name)
        for name in sorted(os.listdir(folder))
        if name.lower().endswith(DEPTH_IMAGES)
    ]


def _name(path: str, root: Path) -> str:
    above = os.path.abspath(root)
    below = Path(path).is_relative_to(above) and path != above
    name = Path(os.path.relpath(path, above) if below else path).as_posix()
    # tables hold UTF-8, names of files any bytes; backslashes are doubled, so that no two are called alike
    return os.fsencode(name.replace("\\", "\\\\")).decode("utf-8", "backslashreplace")


def _input_digest(path: str, kind: str, leave_out: str | None) -> str:
    """Digest what a recording's files are: names, sizes and times, not contents, which may be terabytes.

    Raises
    ------
    OSError
        If it cannot be looked at, or none of its files but a description.
    """
    files = [path]
    if kind == IMAGES:
        # what else is there is none of its frames
        files = images_of(path)
    elif os.path.isdir(path):
        files = _files_below(path, leave_out)
    elif path.lower().endswith(".toml"):
        files = _files_below(os.path.dirname(path), leave_out)
    said, unread, read = [kind], None, False
    for file in files:
        try:
            status = os.stat(file)
        except OSError as error:
            if file == path:
                raise
            # its frame says why, and others are read
            unread = unread if os.path.basename(file).startswith(".") else error
            said.append(f"{os.path.relpath(file, path)}\n{error.errno}")
            continue
        read |= os.path.basename(file) != _DESCRIPTION
        said.append(f"{os.path.relpath(file, path)}\n{status.st_size}\n{status.st_mtime_ns}")
    if unread is not None and not read:
        raise unread
    return digest_of("\n\n".join(said))


def _files_below(folder: str, leave_out: str | None) -> list[str]:
    """Return the paths of all files below a folder but one, in order, and of closed folders in it."""
    files, folders = [], [folder]
    while folders:
        inside = folders.pop()
        try:
            listed = os.scandir(inside)
        except OSError:
            if inside == folder:
                raise
            files.append(inside)
            continue
        with listed as entries:
            for entry in entries:
                if not entry.is_dir():
                    files.append(entry.path)
                elif not entry.is_symlink() and os.path.realpath(entry.path) != leave_out:
                    folders.append(entry.path)
    return sorted(files)


def _stretches(unit: Unit, settings: Settings) -> Iterator[Unit]:
    """Go through a recording's stretches; if it cannot be opened it is one, whose row says why."""
    if settings.stretch is None or unit.kind == SCENE:
        yield unit
        return
    try:
        frames = len(images_of(unit.path)) if unit.kind == IMAGES else _most_frames(unit.path, settings)
    except ImportError:
        raise
    except Exception as error:
        yield replace(unit, error=in_words(error))
        return
    long = settings.stretch * settings.every
    for start in count(0, long):
        last = start + long >= frames
        yield replace(unit, start=start, stop=None if last else start + long)
        if last:
            return


def _most_frames(path: str, settings: Settings) -> int:
    with open_bag(path, settings) as recording:
        return recording.most_frames


def open_bag(path: str, settings: Settings) -> Recording:
    """Open a bag as the settings say."""
    return Recording(
        path,
        settings.topics,
        world=settings.world,
        tolerance=settings.tolerance,
        intrinsics=settings.intrinsics,
        depth_scale=settings.depth_scale,
        ignore_distortion=settings.ignore_distortion,
        max_bytes=settings.max_bytes,
    )


def in_words(error: BaseException) -> str:
    """Say what was wrong: the kind of error, and its message."""
    return f"{type(error).__name__}: {error}"
