"""Units of work: recordings or stretches of them, found in files and folders."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

from strand.batch.settings import Settings, compute_digest
from strand.io.lerobot.layout import INFO, is_data_set
from strand.io.recordings import Recording, is_recording
from strand.io.recordings.bags import SUFFIXES
from strand.io.recordings.ros2_folder import METADATA
from strand.io.view_files import SUFFIXES as VIEW_SUFFIXES
from strand.support.checks import check_instance, check_path, check_sequence
from strand.support.files import FileFormatError, open_file

SCENE = "scene"
"""Kind of a recording that `strand.load_scene` reads."""

BAG = "bag"
"""Kind of a recording that `strand.Recording` reads, LeRobot data sets too."""

IMAGES = "images"
"""Kind of a folder of depth images."""

SCENES = "scenes"
"""Kind of a folder of scenes, one for each frame, whose ropes are tracked."""

DEPTH_SUFFIXES = (".png", ".tif", ".tiff")
"""Suffixes of depth images in a folder."""

_DESCRIPTION = "scene.toml"
_BAG_KEY = b"rosbag2_bagfile_information"  # first key of a bag's metadata
_HEAD_BYTES = 4096  # bytes of the metadata in which that key is


@dataclass(frozen=True)
class Unit:
    """A recording or a stretch of it, with all that a worker needs to open it.

    Attributes
    ----------
    recording : str
        Its name in the rows: the path relative to the root, or the whole path if it is elsewhere.
    path : str
        Its path.
    kind : str
        `SCENE`, `BAG`, `IMAGES` or `SCENES`.
    digest : str or None
        Digest of the names, sizes and modification times of its files; None if they cannot be read.
    start : int
        Number of the first frame.
    stop : int or None
        Number after the last frame; None for the end of the recording.
    error : str or None
        The error of its row, if the search has found that it cannot be read.
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
        """Whether the unit is the whole recording."""
        return self.start == 0 and self.stop is None


def find_units(
    recordings: Sequence[str | os.PathLike[str]],
    settings: Settings,
    root: str | os.PathLike[str],
    excluded: str | os.PathLike[str] | None = None,
) -> Iterator[Unit]:
    """Yield the units of files and folders, each once, in the order of their names.

    The search skips links to folders and single files of one view, unless `recordings` names them. A path
    there that lies below another one comes last. Scenes of one folder are a single unit if the settings have
    `track`; those beside depth images are skipped.

    Parameters
    ----------
    recordings : sequence of paths
        Recordings, and folders to search for recordings.
    settings : Settings
        How to read them.
    root : path
        The folder to which the recordings' names relate.
    excluded : path, optional
        A folder to skip: that of the table.

    Raises
    ------
    FileNotFoundError
        If a path does not exist; before the first unit.
    TypeError
        If `recordings` is not a sequence of paths.
    ValueError
        If a path is empty, or holds no recording; before the first unit.
    """
    check_instance("settings", settings, Settings)
    skipped = None if excluded is None else os.path.realpath(check_path("excluded", excluded))
    listed = check_sequence("recordings", recordings, "paths")
    named = {os.path.abspath(check_path("recordings", path)) for path in listed}
    # several paths may lead to the same recordings: keep one of them, a link only if all are links
    real = {path: os.path.realpath(path) for path in named}
    places = sorted(
        {real[path]: path for path in sorted(named, key=lambda path: (path == real[path], path))}.values()
    )
    root_folder = check_path("root", root)
    for place in places:
        os.stat(place)
    for place in places:
        if next(_search(place, skipped), None) is None:
            hint = ""
            if skipped is not None and Path(skipped).is_relative_to(os.path.realpath(place)):
                hint = f"; {skipped} is the folder of the table (-o), which is not searched; choose another"
            raise ValueError(
                f"recordings: {place} holds none: no folder with a {_DESCRIPTION}, {METADATA}, {INFO} or "
                f"depth images, and no .npz, {', '.join(SUFFIXES)} file{hint}"
            )
    found = _search_all(places, skipped)
    for place, kind in _group_scenes(found, places) if settings.track else found:
        name = _name_recording(place, root_folder)
        try:
            unit = Unit(name, place, kind, _compute_input_digest(place, kind, skipped))
        except OSError as error:
            yield Unit(name, place, kind, None, error=describe_error(error))
        else:
            yield from _split(unit, settings)


def _search_all(places: Sequence[str], skipped: str | None) -> Iterator[tuple[str, str]]:
    """Yield the recordings at all places with their kinds; each once, even if one place is inside another."""
    given = set(places)
    nested = {place for place in places if any(str(parent) in given for parent in Path(place).parents)}
    seen: set[str] = set()
    # the search of an outer place skips single files and links, which a nested place may name
    for place in sorted(places, key=lambda place: place in nested):
        for path, kind in _search(place, skipped):
            if path in seen:
                continue
            if nested and any(str(parent) in nested for parent in (path, *Path(path).parents)):
                seen.add(path)
            yield path, kind


def _group_scenes(found: Iterator[tuple[str, str]], places: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield folders of scenes in the place of their scenes; a scene that the user names stays."""
    given = set(places)
    named = {place for place in given if not any(str(parent) in given for parent in Path(place).parents)}
    frames: dict[str, set[str]] = {}
    for path, kind in found:
        folder = os.path.dirname(path)
        if kind != SCENE or path in named:
            yield path, kind
            continue
        if folder not in frames:
            frames[folder] = set() if list_images(folder) else set(list_scenes(folder))
            if frames[folder]:
                yield folder, SCENES
        if path not in frames[folder] and os.path.isdir(path):
            # a folder that cannot be searched has a row with the reason
            yield path, kind


def _search(place: str, skipped: str | None) -> Iterator[tuple[str, str]]:
    """Yield the recordings at or below a place with their kinds."""
    if not os.path.isdir(place):
        suffix = os.path.splitext(place)[1].lower()
        if suffix in SUFFIXES:
            yield place, BAG
        elif suffix in (".npz", ".toml", *VIEW_SUFFIXES):
            yield place, SCENE
        return
    # a stack instead of recursion, which Python limits to a thousand calls; its end comes first
    stack: list[tuple[str, str | None]] = [(place, None)]
    while stack:
        path, kind = stack.pop()
        if kind is not None:
            yield path, kind
        elif skipped is None or os.path.realpath(path) != skipped:
            stack += reversed(_list_folder(path))


def _list_folder(folder: str) -> list[tuple[str, str | None]]:
    """Return a folder's recordings with their kinds, and its folders to search with None."""
    try:
        with os.scandir(folder) as listed:
            entries = sorted(listed, key=lambda entry: entry.name)
    except OSError:
        # opening it as a scene fails too, and gives the reason
        return [(folder, SCENE)]
    names = {entry.name for entry in entries}
    if names & {"meta", "data"} and is_data_set(folder):
        return [(folder, BAG)]
    if METADATA in names and _is_bag(folder, names):
        return [(folder, BAG)]
    if _DESCRIPTION in names:
        return [(folder, SCENE)]
    found: list[tuple[str, str | None]] = []
    if any(name.lower().endswith(DEPTH_SUFFIXES) for name in names):
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
    """Tell whether a folder with metadata is a bag, maybe a damaged one, and not some other data set."""
    if any(name.endswith(".db3") for name in names):
        return True
    with suppress(OSError, FileFormatError), open_file(os.path.join(folder, METADATA)) as file:
        return _BAG_KEY in file.read(_HEAD_BYTES)
    return False


def list_images(folder: str) -> list[str]:
    """Return the paths of a folder's depth images in the order of their names."""
    return [
        os.path.join(folder, name)
        for name in sorted(os.listdir(folder))
        if name.lower().endswith(DEPTH_SUFFIXES)
    ]


def list_scenes(folder: str) -> list[str]:
    """Return the paths of the scenes directly in a folder in the order of their names."""
    with os.scandir(folder) as entries:
        return sorted(
            entry.path
            for entry in entries
            if entry.name.lower().endswith(".npz")
            or (
                entry.is_dir(follow_symlinks=False) and os.path.isfile(os.path.join(entry.path, _DESCRIPTION))
            )
        )


def list_files(path: str, kind: str, skipped: str | None = None) -> list[str]:
    """Return the paths of a recording's files; those of a folder without those in the folder `skipped`."""
    if kind == IMAGES:
        # other files in the folder are no frames
        return list_images(path)
    if kind == SCENES:
        return [file for scene in list_scenes(path) for file in list_files(scene, SCENE, skipped)]
    if os.path.isdir(path):
        return _list_files_below(path, skipped)
    if path.lower().endswith(".toml"):
        return _list_files_below(os.path.dirname(path), skipped)
    return [path]


def _name_recording(path: str, root: Path) -> str:
    root_path = os.path.abspath(root)
    is_below = Path(path).is_relative_to(root_path) and path != root_path
    name = Path(os.path.relpath(path, root_path) if is_below else path).as_posix()
    # tables hold UTF-8, but file names any bytes; doubled backslashes keep the names distinct
    return os.fsencode(name.replace("\\", "\\\\")).decode("utf-8", "backslashreplace")


def _compute_input_digest(path: str, kind: str, skipped: str | None) -> str:
    """Return a digest of the names, sizes and times of a recording's files; contents may be terabytes.

    Raises
    ------
    OSError
        If the recording cannot be read, or none of its files but a description.
    """
    parts, unreadable, any_read = [kind], None, False
    for file in list_files(path, kind, skipped):
        try:
            status = os.stat(file)
        except OSError as error:
            if file == path:
                raise
            # the row of its frame will give the reason; the other files are read
            unreadable = unreadable if os.path.basename(file).startswith(".") else error
            parts.append(f"{os.path.relpath(file, path)}\n{error.errno}")
            continue
        any_read |= os.path.basename(file) != _DESCRIPTION
        parts.append(f"{os.path.relpath(file, path)}\n{status.st_size}\n{status.st_mtime_ns}")
    if unreadable is not None and not any_read:
        raise unreadable
    return compute_digest("\n\n".join(parts))


def _list_files_below(folder: str, skipped: str | None) -> list[str]:
    """Return the sorted paths of all files below a folder, and of folders that cannot be read."""
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
                elif not entry.is_symlink() and os.path.realpath(entry.path) != skipped:
                    folders.append(entry.path)
    return sorted(files)


def _split(unit: Unit, settings: Settings) -> Iterator[Unit]:
    """Yield the stretches of a recording; a recording that cannot be opened is one unit with its error.

    No stretch has frames of two episodes of a data set, which are recordings of their own.
    """
    episodes = unit.kind == BAG and is_data_set(unit.path)
    if unit.kind == SCENE or (settings.stretch is None and not episodes):
        yield unit
        return
    try:
        parts = (
            (range(len(list_images(unit.path))),) if unit.kind == IMAGES else _list_parts(unit.path, settings)
        )
    except ImportError:
        raise
    except Exception as error:
        yield replace(unit, error=describe_error(error))
        return
    for part in parts:
        length = len(part) if settings.stretch is None else settings.stretch * settings.every
        for start in count(part.start, max(length, 1)):
            last = start + length >= part.stop
            end = part.stop if episodes else None
            yield replace(unit, start=start, stop=end if last else start + length)
            if last:
                break


def _list_parts(path: str, settings: Settings) -> tuple[range, ...]:
    """Return the frames of each episode of a data set, or all of another recording."""
    with open_bag(path, settings) as recording:
        return recording.episodes or (range(recording.most_frames),)


def open_bag(path: str, settings: Settings) -> Recording:
    """Open a bag with these settings."""
    return Recording(
        path,
        settings.topics,
        world=settings.world,
        tolerance=settings.tolerance,
        intrinsics=settings.intrinsics,
        depth_scale=settings.depth_scale,
        color_topics=settings.color_topics,
        ignore_distortion=settings.ignore_distortion,
        max_bytes=settings.max_bytes,
    )


def describe_error(error: BaseException) -> str:
    """Return the kind of an error and its message."""
    return f"{type(error).__name__}: {error}"
