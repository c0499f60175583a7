"""The frames of a unit: their views, and the recording's facts about the ropes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from strand.batch.settings import Settings
from strand.batch.units import BAG, IMAGES, SCENES, Unit, list_images, list_scenes, open_bag
from strand.io.budget import Budget
from strand.io.recordings.frames import UndecodedFrame
from strand.io.recordings.recording import Recording
from strand.io.scenes import load_scene
from strand.io.single_view import KnownCamera, read_single_view
from strand.io.view_files import SUFFIXES
from strand.support.files import FileFormatError
from strand.views.box import Bounds
from strand.views.view import View


@dataclass(frozen=True, eq=False)
class FrameInput:
    """The input of one reconstruction.

    Attributes
    ----------
    time : float or None
        Time of the latest view, seconds since 1970; None if the recording does not hold it.
    views : tuple of View
    radius : float or None
        The ropes' radius, metres, if the recording holds it.
    bounds : pair of (3,) ndarray, Box, or None
        The extraction range, if the recording holds it.
    times : tuple of float or None
        Time of each view, seconds since 1970, if the recording holds them.
    """

    time: float | None
    views: tuple[View, ...]
    radius: float | None = None
    bounds: Bounds | None = None
    times: tuple[float, ...] | None = None


def iterate_frames(
    unit: Unit, settings: Settings, beside: Mapping[str, Sequence[Path]] | None = None
) -> Iterator[tuple[int, Callable[[], FrameInput]]]:
    """Yield the number of each frame of a unit, and a function that reads the frame.

    `beside` has masks, colours and occluders of a folder of images by the key of a view, one for each image.
    Raises an error if the recording cannot be opened or ends in damage. The function raises an error if its
    frame is damaged; the iteration then goes on.
    """
    if unit.kind == BAG:
        with open_bag(unit.path, settings) as recording:
            for frame in recording.read_undecoded(unit.start, unit.stop, settings.every):
                yield frame.number, partial(_decode, recording, frame)
        return
    camera = KnownCamera(settings.viewpoint, settings.camera_frame, settings.intrinsics, settings.depth_scale)
    if unit.kind == IMAGES:
        paths = list_images(unit.path)
        if not paths:
            raise FileFormatError(unit.path, "no depth image is left")
        for number in range(len(paths))[unit.start : unit.stop : settings.every]:
            own = {key: [files[number]] for key, files in (beside or {}).items()}
            yield number, partial(_read_image, paths[number], camera, settings, own)
        return
    if unit.kind == SCENES:
        paths = list_scenes(unit.path)
        if not paths:
            raise FileFormatError(unit.path, "no scene is left")
        for number in range(len(paths))[unit.start : unit.stop : settings.every]:
            yield number, partial(_read_scene, paths[number], camera, settings)
        return
    # a scene that cannot be read cannot be opened, so this comes before the first frame
    scene = _read_scene(unit.path, camera, settings)
    yield 0, lambda: scene


def _decode(recording: Recording, frame: UndecodedFrame) -> FrameInput:
    decoded = recording.decode(frame)
    return FrameInput(max(decoded.times), decoded.views, times=decoded.times)


def _read_image(
    path: str, camera: KnownCamera, settings: Settings, beside: Mapping[str, Sequence[Path]]
) -> FrameInput:
    return FrameInput(None, (read_single_view(Path(path), camera, beside, Budget(settings.max_bytes)),))


def _read_scene(path: str, camera: KnownCamera, settings: Settings) -> FrameInput:
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
    return FrameInput(None, scene.views, scene.radius, scene.bounds)
