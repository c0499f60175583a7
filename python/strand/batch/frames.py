"""Frames of a unit: what the cameras saw at each time, with what the recording says of the ropes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from strand.batch.settings import Settings
from strand.batch.units import BAG, IMAGES, Unit, images_of, open_bag
from strand.box import Bounds
from strand.files import FileFormatError
from strand.io.budget import Budget
from strand.io.scenes import load_scene
from strand.io.single import Camera, read_view
from strand.io.view_files import SUFFIXES
from strand.view import View


@dataclass(frozen=True, eq=False)
class Seen:
    """What the cameras saw at one time.

    Attributes
    ----------
    number : int
        Which frame of the recording it is, from 0.
    time : float or None
        When, seconds since 1970; None if the recording does not say it.
    views : tuple of View
    radius : float or None
        The ropes' radius, metres, if the recording says it.
    bounds : pair of (3,) ndarray, Box, or None
        The extraction range, if the recording says it.
    """

    number: int
    time: float | None
    views: tuple[View, ...]
    radius: float | None = None
    bounds: Bounds | None = None


def frames(unit: Unit, settings: Settings) -> Iterator[Seen]:
    """Go through the frames of a unit, one in memory at a time.

    Raises
    ------
    OSError, strand.StrandError, TypeError, ValueError, ImportError
        As `strand.load_scene` and `strand.Recording` do.
    """
    if unit.kind == BAG:
        with open_bag(unit.path, settings) as recording:
            for frame in recording.read(unit.start, unit.stop, settings.every):
                yield Seen(frame.number, frame.time, frame.views)
        return
    camera = Camera(settings.viewpoint, settings.camera_frame, settings.intrinsics, settings.depth_scale)
    if unit.kind == IMAGES:
        paths = images_of(unit.path)
        if not paths:
            raise FileFormatError(unit.path, "no depth image is left")
        for number in range(len(paths))[unit.start : unit.stop : settings.every]:
            view = read_view(Path(paths[number]), camera, None, Budget(settings.max_bytes))
            yield Seen(number, None, (view,))
        return
    single = Path(unit.path).suffix.lower() in SUFFIXES
    scene = load_scene(
        unit.path,
        viewpoint=camera.viewpoint if single else None,
        camera_frame=camera.camera_frame if single else False,
        intrinsics=camera.intrinsics if single else None,
        depth_scale=camera.depth_scale if single else None,
        max_bytes=settings.max_bytes,
        outside=settings.outside,
    )
    yield Seen(0, None, scene.views, scene.radius, scene.bounds)
