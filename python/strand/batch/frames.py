"""Frames of a unit: what the cameras saw at each time, with what the recording says of the ropes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from strand.batch.settings import Settings
from strand.batch.units import BAG, IMAGES, Unit, images_of, open_bag
from strand.io.budget import Budget
from strand.io.recordings.recording import Recording, UndecodedFrame
from strand.io.scenes import load_scene
from strand.io.single_view import KnownCamera, read_single_view
from strand.io.view_files import SUFFIXES
from strand.support.files import FileFormatError
from strand.views.box import Bounds
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class Seen:
    """What the cameras saw at one time.

    Attributes
    ----------
    time : float or None
        When, seconds since 1970; None if the recording does not say it.
    views : tuple of View
    radius : float or None
        The ropes' radius, metres, if the recording says it.
    bounds : pair of (3,) ndarray, Box, or None
        The extraction range, if the recording says it.
    """

    time: float | None
    views: tuple[View, ...]
    radius: float | None = None
    bounds: Bounds | None = None


def frames(unit: Unit, settings: Settings) -> Iterator[tuple[int, Callable[[], Seen]]]:
    """Go through the frames of a unit, one in memory at a time: their numbers, and how each is read.

    Raises
    ------
    OSError, strand.StrandError, TypeError, ValueError, ImportError
        If the recording cannot be opened, or ends in damage. How a frame is read raises them too, and spoils
        no other frame.
    """
    if unit.kind == BAG:
        with open_bag(unit.path, settings) as recording:
            for frame in recording.read_undecoded(unit.start, unit.stop, settings.every):
                yield frame.number, partial(_decoded, recording, frame)
        return
    camera = KnownCamera(settings.viewpoint, settings.camera_frame, settings.intrinsics, settings.depth_scale)
    if unit.kind == IMAGES:
        paths = images_of(unit.path)
        if not paths:
            raise FileFormatError(unit.path, "no depth image is left")
        for number in range(len(paths))[unit.start : unit.stop : settings.every]:
            yield number, partial(_image, paths[number], camera, settings)
        return
    # a scene is opened by reading all of it
    scene = _scene(unit.path, camera, settings)
    yield 0, lambda: scene


def _decoded(recording: Recording, frame: UndecodedFrame) -> Seen:
    decoded = recording.decode(frame)
    return Seen(decoded.time, decoded.views)


def _image(path: str, camera: KnownCamera, settings: Settings) -> Seen:
    return Seen(None, (read_single_view(Path(path), camera, None, Budget(settings.max_bytes)),))


def _scene(path: str, camera: KnownCamera, settings: Settings) -> Seen:
    single = Path(path).suffix.lower() in SUFFIXES
    scene = load_scene(
        path,
        viewpoint=camera.viewpoint if single else None,
        camera_frame=camera.camera_frame if single else False,
        intrinsics=camera.intrinsics if single else None,
        depth_scale=camera.depth_scale if single else None,
        max_bytes=settings.max_bytes,
        outside=settings.outside,
    )
    return Seen(None, scene.views, scene.radius, scene.bounds)
