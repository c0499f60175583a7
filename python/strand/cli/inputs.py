"""The input of a command: a scene, or frames of a recording."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from strand.cli.progress import show_progress
from strand.io.intrinsics import read_intrinsics
from strand.io.recordings import Recording, is_recording
from strand.io.recordings.recording import TOLERANCE
from strand.io.scenes import Scene, load_scene
from strand.support.checks import Array

_RECORDING_OPTIONS = (
    *(
        "topic",
        "frame",
        "every",
        "episode",
        "world",
        "tolerance",
        "ignore_distortion",
        "color_topic",
        "no_color",
    ),
)
_SCENE_OPTIONS = ("viewpoint", "camera_frame", "mask", "color", "occluders")


def load_input(options: argparse.Namespace) -> Scene:
    """Read a scene, or one frame of a recording."""
    with show_progress("read"):
        path = _get_only(options.scene)
        return _load_frame(options, path) if is_recording(path) else _load_scene(options, path)


def _load_frame(options: argparse.Namespace, path: Path) -> Scene:
    with open_recording(options) as recording:
        number, _ = choose_frames(options, recording)
        frame = next(recording.read(number, number + 1), None)
        if frame is None:
            raise ValueError(describe_missing_frame(number, len(recording)))
        return Scene(path.name, frame.views, None, None, files=recording.files)


def find_frame_id(options: argparse.Namespace) -> str:
    """Return the frame of the ropes: that of a recording's world, else "world"."""
    if not is_recording(_get_only(options.scene)):
        return "world"
    with open_recording(options) as recording:
        return recording.frame_id


def choose_frames(options: argparse.Namespace, recording: Recording) -> tuple[int, int | None]:
    """Return the first frame, and that after the last one: of the recording, or of an episode of it."""
    number = options.frame or 0
    if options.episode is None:
        if number < 0:
            raise ValueError(describe_missing_frame(number, len(recording)))
        return number, None
    if not recording.episodes:
        raise ValueError(f"--episode: for LeRobot data sets only, and {recording.path} is none")
    count = len(recording.episodes)
    if not 0 <= options.episode < count:
        raise ValueError(f"--episode {options.episode}: the data set has {_describe_range(count, 'episode')}")
    frames = recording.episodes[options.episode]
    if not 0 <= number < len(frames):
        raise ValueError(describe_missing_frame(number, len(frames), "episode"))
    return frames.start + number, frames.stop


def describe_missing_frame(number: int, count: int, what: str = "recording") -> str:
    """Say which frames a recording of `count` frames has instead of frame `number`."""
    return f"--frame {number}: the {what} has {_describe_range(count, 'frame')}"


def _describe_range(count: int, what: str) -> str:
    return (
        f"no {what}s"
        if count == 0
        else f"1 {what}, 0"
        if count == 1
        else f"{count} {what}s, 0 to {count - 1}"
    )


def _load_scene(options: argparse.Namespace, path: Path) -> Scene:
    _refuse_options(options, _RECORDING_OPTIONS, f"for recordings only, and {path} is none")
    return load_scene(
        path,
        options.mask,
        colors=options.color,
        occluders=options.occluders,
        viewpoint=options.viewpoint,
        camera_frame=options.camera_frame,
        intrinsics=load_intrinsics(options.intrinsics),
        depth_scale=options.depth_scale,
        max_bytes=options.max_bytes,
        outside=options.outside,
    )


def open_recording(options: argparse.Namespace) -> Recording:
    """Open a recording."""
    path = _get_only(options.scene)
    if not is_recording(path):
        _refuse_options(options, _RECORDING_OPTIONS, f"for recordings only, and {path} is none")
    _refuse_options(options, _SCENE_OPTIONS, f"for scenes only, and {path} is a recording")
    return Recording(
        path,
        options.topic,
        world=options.world,
        tolerance=TOLERANCE if options.tolerance is None else options.tolerance,
        intrinsics=load_intrinsics(options.intrinsics),
        depth_scale=options.depth_scale,
        color_topics=choose_color_topics(options),
        ignore_distortion=options.ignore_distortion,
        max_bytes=options.max_bytes,
    )


def collect_settings(options: argparse.Namespace) -> dict[str, Any]:
    """Return keyword arguments of `strand.batch.Settings`: how to read recordings."""
    return {
        "every": options.every,
        "topics": options.topic,
        "world": options.world,
        "tolerance": TOLERANCE if options.tolerance is None else options.tolerance,
        "ignore_distortion": options.ignore_distortion,
        "intrinsics": load_intrinsics(options.intrinsics),
        "depth_scale": options.depth_scale,
        "color_topics": choose_color_topics(options),
        "max_bytes": options.max_bytes,
        "outside": options.outside,
    }


def choose_color_topics(options: argparse.Namespace) -> Sequence[str] | None:
    """Return the colour topics of a recording: none with --no-color, and None for the default."""
    if options.no_color and options.color_topic is not None:
        raise ValueError("--no-color: expected either --color-topic or --no-color, got both")
    topics: Sequence[str] | None = () if options.no_color else options.color_topic
    return topics


def list_input_files(options: argparse.Namespace, scene: Scene) -> tuple[Path, ...]:
    """Return the scene's files, and the files that options name."""
    given = (options.config, options.intrinsics if isinstance(options.intrinsics, Path) else None)
    return (*scene.files, *(path for path in given if path is not None))


def _get_only(scenes: Sequence[Path]) -> Path:
    if len(scenes) > 1:
        raise ValueError(
            f"SCENE: expected one, got {len(scenes)}; for files of several views, write a folder with a "
            "scene.toml, which holds their poses"
        )
    return scenes[0]


def _refuse_options(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Refuse options that do not apply to this input."""
    for name in names:
        if (value := vars(options).get(name)) is not None and value is not False:
            raise ValueError(f"--{name.replace('_', '-')}: {why}")


def load_intrinsics(given: tuple[float, ...] | Path | None) -> Array | None:
    """Return the (3, 3) pinhole matrix from four numbers or from a file; None without intrinsics."""
    if given is None or isinstance(given, Path):
        return None if given is None else read_intrinsics(given)
    fx, fy, cx, cy = given
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
