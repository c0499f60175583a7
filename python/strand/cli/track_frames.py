"""The frames of `strand track`: of a recording, of a folder of depth images, or of a folder of scenes."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from strand.batch import Settings, find_units
from strand.batch.frames import FrameInput, iterate_frames
from strand.batch.units import BAG, IMAGES, Unit, list_files, list_images, list_scenes, open_bag
from strand.cli.arguments import collect_arguments
from strand.cli.inputs import collect_settings
from strand.io.lerobot.layout import is_data_set
from strand.support.checks import check_integer
from strand.support.files import FileFormatError

_BESIDE = ("mask", "color", "occluders")  # folders with an image for each depth image


class FrameSource:
    """The frames that the command's options name.

    Parameters
    ----------
    options : argparse.Namespace

    Attributes
    ----------
    settings : Settings
    recording : str
        The recording's name in tables.
    files : tuple of Path
        The files that are read.
    starts : frozenset of int
        The frames that begin a recording, or an episode of a data set.

    Raises
    ------
    OSError
        If a path is missing or cannot be read.
    ValueError
        If the options do not fit the recording, or it is none.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._path: Path = options.recording
        self.settings = Settings(
            **collect_arguments(options), **collect_settings(options), track=True, rate=options.rate
        )
        self._start = check_integer("--frame", options.frame)
        units = list(find_units([self._path], self.settings, self._path.parent))
        # folders inside a folder of images may hold its masks
        units = [unit for unit in units if unit.path == os.path.abspath(self._path)] or units
        if len({unit.path for unit in units}) > 1:
            raise ValueError(
                f"RECORDING: expected one, got {len(units)} in {self._path}; a folder holds either "
                "depth images or scenes, one for each frame"
            )
        self._unit = units[0]
        self.recording = self._unit.recording
        self._episode: int | None = options.episode
        self._units = self._choose_units(units)
        self.starts = frozenset(unit.start for unit in self._units)
        if self._unit.kind == BAG and options.rate is not None:
            raise ValueError(f"--rate: for folders only; {self._path} has the times of its images")
        self._beside = self._find_beside(options)
        own = map(Path, list_files(self._unit.path, self._unit.kind))
        self.files = (*own, *(path for paths in self._beside.values() for path in paths))

    @property
    def frame_id(self) -> str:
        """The frame of the ropes, for messages."""
        if self._unit.kind != BAG:
            return "world"
        with open_bag(self._unit.path, self.settings) as recording:
            return recording.frame_id

    def __iter__(self) -> Iterator[tuple[int, Callable[[], FrameInput]]]:
        """Yield the number of each frame, and a function that reads it."""
        for unit in self._units:
            yield from iterate_frames(unit, self.settings, self._beside)

    def count_frames(self) -> tuple[int, str]:
        """Return how many frames there are, and in what: an episode, a recording, or a folder."""
        if self._unit.kind != BAG:
            listed = list_images if self._unit.kind == IMAGES else list_scenes
            return len(listed(self._unit.path)), "folder"
        with open_bag(self._unit.path, self.settings) as recording:
            if self._episode is not None:
                return len(recording.episodes[self._episode]), "episode"
            return len(recording), "recording"

    def _choose_units(self, units: list[Unit]) -> list[Unit]:
        """Return the units from the first frame on: one, or all episodes of a data set or one of them."""
        episode = self._episode
        if units[0].kind == BAG and is_data_set(units[0].path):
            if units[0].error is not None:
                open_bag(units[0].path, self.settings).close()  # raises the error
            count = len(units)
            if episode is not None and not 0 <= episode < count:
                raise ValueError(f"--episode {episode}: the data set has {count} episodes, 0 to {count - 1}")
            chosen = units if episode is None else [units[episode]]
            begun = chosen[0].start + self._start
            left = [unit for unit in chosen if unit.stop is not None and unit.stop > begun]
            return [replace(unit, start=max(unit.start, begun)) for unit in left]
        if episode is not None:
            raise ValueError(f"--episode: for LeRobot data sets only, and {self._path} is none")
        return [replace(units[0], start=self._start)]

    def _find_beside(self, options: argparse.Namespace) -> dict[str, list[Path]]:
        """Return the masks, colours and occluders of a folder of depth images, one for each image."""
        given = {key: vars(options)[key] for key in _BESIDE if vars(options)[key] is not None}
        if not given:
            return {}
        if self._unit.kind != IMAGES:
            raise ValueError(
                f"--{next(iter(given))}: for folders of depth images only, and {self._path} is none"
            )
        names = [Path(path).stem for path in list_images(self._unit.path)]
        found = {}
        for key, folder in given.items():
            files = {path.stem: path for path in sorted(folder.iterdir())}
            missing = [name for name in names if name not in files]
            if missing:
                raise ValueError(
                    f"--{key}: expected an image for each depth image, and {folder} has no {missing[0]}"
                )
            found[key] = [files[name] for name in names]
        return found


def require_depth(path: Path, frame: FrameInput) -> None:
    """Raise FileFormatError if a view has no depth image."""
    if any(view.image is None for view in frame.views):
        raise FileFormatError(path, "expected depth images, which a tracker needs, got points")
