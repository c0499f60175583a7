"""What is read: a scene, or frames of a recording, as the options say."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from strand.cli.progress import progress
from strand.io.intrinsics import read_intrinsics
from strand.io.recordings import Recording, is_recording
from strand.io.recordings.recording import TOLERANCE
from strand.io.scenes import Scene, load_scene
from strand.support.checks import Array

_OF_RECORDINGS = ("topic", "frame", "every", "world", "tolerance", "ignore_distortion")
_OF_FILES = ("viewpoint", "camera_frame", "mask")


def load(options: argparse.Namespace) -> Scene:
    """Read a scene, or one frame of a recording."""
    with progress("read"):
        return _loaded(options)


def _loaded(options: argparse.Namespace) -> Scene:
    path = _only(options.scene)
    if is_recording(path):
        with open_recording(options) as recording:
            number = options.frame or 0
            frame = next(recording.read(number, number + 1), None)
            if frame is None:
                raise ValueError(
                    f"--frame: expected less than the recording's {len(recording)}, got {number}"
                )
            return Scene(path.name, frame.views, None, None, files=recording.files)
    _refuse(options, _OF_RECORDINGS, f"for recordings only, and {path} is none")
    return load_scene(
        path,
        options.mask,
        viewpoint=options.viewpoint,
        camera_frame=options.camera_frame,
        intrinsics=matrix_of(options.intrinsics),
        depth_scale=options.depth_scale,
        max_bytes=options.max_bytes,
        outside=options.outside,
    )


def open_recording(options: argparse.Namespace) -> Recording:
    """Open a recording."""
    path = _only(options.scene)
    if not is_recording(path):
        _refuse(options, _OF_RECORDINGS, f"for recordings only, and {path} is none")
    _refuse(options, _OF_FILES, "for scenes only; a recording has its own")
    return Recording(
        path,
        options.topic,
        world=options.world,
        tolerance=TOLERANCE if options.tolerance is None else options.tolerance,
        intrinsics=matrix_of(options.intrinsics),
        depth_scale=options.depth_scale,
        ignore_distortion=options.ignore_distortion,
        max_bytes=options.max_bytes,
    )


def files_read(options: argparse.Namespace, recorded: Scene) -> tuple[Path, ...]:
    """Return the scene's files, and those that options name."""
    given = (options.config, options.intrinsics if isinstance(options.intrinsics, Path) else None)
    return (*recorded.files, *(path for path in given if path is not None))


def _only(scenes: Sequence[Path]) -> Path:
    if len(scenes) > 1:
        raise ValueError(
            f"SCENE: expected one, got {len(scenes)}; files of several views need a pose each, which "
            "the scene.toml of a folder says"
        )
    return scenes[0]


def _refuse(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Refuse options that are not for what was given."""
    for name in names:
        if (given := vars(options).get(name)) is not None and given is not False:
            raise ValueError(f"--{name.replace('_', '-')}: {why}")


def matrix_of(given: tuple[float, ...] | Path | None) -> Array | None:
    """(3, 3) The pinhole matrix of four numbers, or of a file."""
    if given is None or isinstance(given, Path):
        return None if given is None else read_intrinsics(given)
    fx, fy, cx, cy = given
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
