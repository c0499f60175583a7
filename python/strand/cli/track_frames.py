"""The frames of `strand track`: of a recording, of a folder of depth images, or of a folder of scenes."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

from strand.batch import Settings, Unit, find_units
from strand.batch.frames import FrameInput, iterate_frames
from strand.batch.units import BAG, IMAGES, SCENE, list_images
from strand.cli.inputs import choose_color_topics, load_intrinsics
from strand.io.recordings.recording import TOLERANCE
from strand.support.checks import check_integer, check_positive
from strand.support.files import FileFormatError

RATE = 30.0  # frames per second of a folder, unless the user gives another number

_BESIDE = ("mask", "color", "occluders")  # folders with an image for each depth image


class FrameSource:
    """The frames that the command's options name.

    Parameters
    ----------
    options : argparse.Namespace

    Attributes
    ----------
    files : tuple of Path
        The files that are read.

    Raises
    ------
    OSError
        If a path is missing or cannot be read.
    ValueError
        If the options do not fit the recording, or it is none.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self._path: Path = options.recording
        self._settings = _make_settings(options)
        self._start = check_integer("--frame", options.frame)
        units = list(find_units([self._path], self._settings, self._path.parent))
        # folders inside a folder of images may hold its masks
        units = [unit for unit in units if unit.path == os.path.abspath(self._path)] or units
        # scenes of one folder are frames; anything else is a recording of its own
        if len(units) > 1 and any(unit.kind != SCENE for unit in units):
            raise ValueError(
                f"RECORDING: expected one, got {len(units)} in {self._path}; a folder holds either "
                "depth images or scenes, one for each frame"
            )
        self._units = units
        self._rate = (
            None if self._is_bag else check_positive("--rate", RATE if options.rate is None else options.rate)
        )
        if self._is_bag and options.rate is not None:
            raise ValueError(f"--rate: for folders only; {self._path} has the times of its images")
        self._beside = self._find_beside(options)
        self.files = (*self._list_files(), *(path for paths in self._beside.values() for path in paths))

    @property
    def _is_bag(self) -> bool:
        return self._units[0].kind == BAG

    def __iter__(self) -> Iterator[tuple[int, Callable[[], FrameInput]]]:
        """Yield the number of each frame, and a function that reads it."""
        if self._units[0].kind == SCENE:
            scenes = islice(enumerate(self._units), self._start, None, self._settings.every)
            yield from ((number, partial(_read_scene, unit, self._settings)) for number, unit in scenes)
            return
        whole = replace(self._units[0], start=self._start)
        yield from iterate_frames(whole, self._settings, self._beside)

    def find_times(self, number: int, frame: FrameInput) -> tuple[float, ...]:
        """Return the time of each view of a frame, s: since 1970, or since a folder's first frame."""
        if frame.times is not None:
            return frame.times
        assert self._rate is not None
        return (number / self._rate,) * len(frame.views)

    def _find_beside(self, options: argparse.Namespace) -> dict[str, list[Path]]:
        """Return the masks, colours and occluders of a folder of depth images, one for each image."""
        given = {key: vars(options)[key] for key in _BESIDE if vars(options)[key] is not None}
        if not given:
            return {}
        if self._units[0].kind != IMAGES:
            raise ValueError(
                f"--{next(iter(given))}: for folders of depth images only, and {self._path} is none"
            )
        names = [Path(path).stem for path in list_images(self._units[0].path)]
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

    def _list_files(self) -> list[Path]:
        files = []
        for unit in self._units:
            path = Path(unit.path)
            files += [path] if path.is_file() else [one for one in path.iterdir() if one.is_file()]
        return files


def _read_scene(unit: Unit, settings: Settings) -> FrameInput:
    return next(iterate_frames(unit, settings))[1]()


def _make_settings(options: argparse.Namespace) -> Settings:
    return Settings(
        every=options.every,
        topics=options.topic,
        world=options.world,
        tolerance=TOLERANCE if options.tolerance is None else options.tolerance,
        ignore_distortion=options.ignore_distortion,
        intrinsics=load_intrinsics(options.intrinsics),
        depth_scale=options.depth_scale,
        color_topics=choose_color_topics(options),
        max_bytes=options.max_bytes,
        outside=options.outside,
    )


def require_depth(path: Path, frame: FrameInput) -> None:
    """Raise FileFormatError if a view has no depth image."""
    if any(view.image is None for view in frame.views):
        raise FileFormatError(path, "expected depth images, which a tracker needs, got points")
