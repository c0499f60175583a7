"""What `strand reconstruct` would do with a file: which options it needs, and what it works out itself."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from strand.io.file_contents import Contents, SceneContents, SingleContents
from strand.io.recordings.recording_contents import RecordingContents
from strand.ropes.model import Model


@dataclass(frozen=True)
class Advice:
    """What `strand reconstruct` would do.

    Attributes
    ----------
    command : str or None
        The command line; words in capitals stand for what the file does not say. None if it cannot read it.
    missing : tuple of str
        What the file does not say.
    would : dict of str to str
        What would be done, in words, about the "topics", "frames", "world" frame, "view", "ropes", "method",
        "radius" and "poses", where there is something to say; or why it is "refused".
    """

    command: str | None
    missing: tuple[str, ...]
    would: dict[str, str]


_NOTHING = Advice(None, ("points",), {"refused": "it holds no point"})


def advice(path: Path, held: Contents, asked: bool = False) -> Advice:
    """Return what `strand reconstruct` would do with a file that holds this.

    Parameters
    ----------
    path : Path
        The file.
    held : Contents
    asked : bool
        Whether a recording's topics are those that were asked for.
    """
    match held:
        case Model():
            return Advice(None, (), {"refused": "it is a model, which strand.load_model() reads"})
        case SceneContents(views=views) if not any(view.points for view in views):
            return _NOTHING
        case SingleContents(view=view) if not view.points:
            return _NOTHING
        case SceneContents():
            return _of_scene(path, held)
        case SingleContents():
            return _of_single(path, held)
        case RecordingContents():
            return _of_recording(path, held, asked)


def _of_scene(path: Path, held: SceneContents) -> Advice:
    masked = any(view.labels is not None for view in held.views)
    bounded, images = held.bounds is not None, any(view.kind == "depth image" for view in held.views)
    missing = []
    if held.radius is None:
        missing.append("radius")
    if not (bounded or masked):
        missing.append("bounds and masks")
    would = _method(masked, bounded, images) | _radius(held.radius, len(held.views))
    if len(held.views) > 1:
        would["poses"] = "start from those of the scene; views are fitted to each other"
    return Advice(_command(path), tuple(missing), would)


def _of_single(path: Path, held: SingleContents) -> Advice:
    image = held.view.kind == "depth image"
    options, missing, would = [], [], {}
    if image:
        missing.append("intrinsics")
        options = ["--intrinsics FX,FY,CX,CY"]
        if held.whole:
            missing.append("unit of depth")
            options.append("--depth-scale METRES")
    elif held.viewpoint is None:
        missing.append("viewpoint")
        options = ["--viewpoint X,Y,Z"]
        would["view"] = "--viewpoint for points in the world frame, --camera-frame for points in the camera's"
    missing += ["radius", "bounds and masks" if image else "bounds"]
    would |= _method(False, False, image) | _radius(None, 1)
    return Advice(_command(path, options), tuple(missing), would)


def _of_recording(path: Path, held: RecordingContents, asked: bool) -> Advice:
    usable = [camera for camera in held.cameras if camera.view is not None]
    if not usable:
        return Advice(None, ("depth that can be read",), {"refused": "no topic shows depth that can be read"})
    first, options, would = usable[0], [], {}
    if len(held.cameras) > 1 or asked:
        options.append(f"--topic {shlex.quote(first.topic)}")
    if len(held.cameras) > 1:
        would["topics"] = f"the first of {len(held.cameras)}; several --topic together need --world FRAME"
    would["frames"] = "the only one"
    if first.messages > 1:
        would["frames"] = f"the first of {first.messages}; --frame N for another one, --every N for many"
    would["world"] = "the camera's frame"
    if held.tf_frames:
        would["world"] += "; --world FRAME for another one of TF"
    image = first.view is not None and first.view.kind == "depth image"
    would |= _method(False, False, image) | _radius(None, 1)
    return Advice(_command(path, options), ("radius", "bounds"), would)


def _method(masked: bool, bounded: bool, images: bool) -> dict[str, str]:
    """Say what counts as rope, and how it is worked on."""
    inside = [*(["the bounds"] if bounded else []), *(["the masks"] if masked else [])]
    ropes = f"what is inside {' and '.join(inside)}"
    if bounded and not masked:
        ropes += "; if that is a table, ropes on it"
    if not inside:
        ropes = (
            "no bounds and no masks: a table is looked for, and ropes on it; without a table everything is "
            "rope; --bounds says where ropes are"
        )
    if masked:
        method = "readings of the masks first, tubes where these are unsure"
    elif bounded or not images:
        method = "tubes first" + (", readings of images where these are unsure" if images else "")
    else:
        method = "readings of images first if a table is found, else tubes"
    return {"ropes": ropes, "method": method}


def _radius(radius: float | None, views: int) -> dict[str, str]:
    if radius is not None:
        return {"radius": f"{radius * 1e3:.3g} mm, as the scene says"}
    known = "" if views > 1 else ", to about 10 % from one view"
    return {"radius": f"estimated from how wide ropes look{known}; --radius says it"}


def _command(path: Path, options: Sequence[str] = ()) -> str:
    return " ".join(["strand reconstruct", shlex.quote(str(path)), *options])
