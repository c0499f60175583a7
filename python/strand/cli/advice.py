"""The advice of `strand info`: the options that `strand reconstruct` needs, and what it would do."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from strand.io.file_contents import Contents, SceneContents, SingleContents
from strand.io.recordings.recording_contents import RecordingContents


@dataclass(frozen=True)
class Advice:
    """The command that reconstructs a file, and what it would do.

    Attributes
    ----------
    command : str or None
        The command line; words in capitals stand for values that the file does not hold. None if strand
        cannot reconstruct the file.
    missing : tuple of str
        The values that the file does not hold.
    plan : dict of str to str
        Sentences about the "topics", "frames", "world" frame, "view", "ropes", "method", "radius" and
        "poses", where there is something to say; or the reason why the file is "refused".
    """

    command: str | None
    missing: tuple[str, ...]
    plan: dict[str, str]


_EMPTY = Advice(None, ("points",), {"refused": "it holds no points"})


def advise(path: Path, contents: Contents, topics_given: bool = False) -> Advice:
    """Return the command for a file with these contents, and what it would do.

    `topics_given` says whether the user chose the topics of a recording.
    """
    match contents:
        case SceneContents(views=views) if not any(view.points for view in views):
            return _EMPTY
        case SingleContents(view=view) if not view.points:
            return _EMPTY
        case SceneContents():
            return _advise_scene(path, contents)
        case SingleContents():
            return _advise_single(path, contents)
        case RecordingContents():
            return _advise_recording(path, contents, topics_given)
        case _:
            return Advice(None, (), {"refused": "it is a model, which strand.load_model() reads"})


def _advise_scene(path: Path, scene: SceneContents) -> Advice:
    masked = any(view.labels is not None for view in scene.views)
    bounded, images = scene.bounds is not None, any(view.kind == "depth image" for view in scene.views)
    missing = []
    if scene.radius is None:
        missing.append("radius")
    if not (bounded or masked):
        missing.append("bounds or masks")
    plan = _plan_method(masked, bounded, images) | _plan_radius(scene.radius, len(scene.views))
    if len(scene.views) > 1:
        plan["poses"] = "those of the scene, then refined by aligning the views"
    return Advice(_make_command(path), tuple(missing), plan)


def _advise_single(path: Path, file: SingleContents) -> Advice:
    image = file.view.kind == "depth image"
    options, missing, plan = [], [], {}
    if image:
        missing.append("intrinsics")
        options = ["--intrinsics FX,FY,CX,CY"]
        if file.whole:
            missing.append("unit of depth")
            options.append("--depth-scale METRES")
    elif file.viewpoint is None:
        missing.append("viewpoint")
        options = ["--viewpoint X,Y,Z"]
        plan["view"] = "--viewpoint for points in the world frame, --camera-frame for points in the camera's"
    missing += ["radius", "bounds or masks" if image else "bounds"]
    plan |= _plan_method(False, False, image) | _plan_radius(None, 1)
    return Advice(_make_command(path, options), tuple(missing), plan)


def _advise_recording(path: Path, recording: RecordingContents, topics_given: bool) -> Advice:
    readable = [camera for camera in recording.cameras if camera.view is not None]
    if not readable:
        return Advice(None, ("readable depth",), {"refused": "no topic has readable depth"})
    first, options, plan = readable[0], [], {}
    if len(recording.cameras) > 1 or topics_given:
        options.append(f"--topic {shlex.quote(first.topic)}")
    if len(recording.cameras) > 1:
        plan["topics"] = f"the first of {len(recording.cameras)}; several --topic also need --world FRAME"
    plan["frames"] = "the only one"
    if first.messages > 1:
        plan["frames"] = f"the first of {first.messages}; --frame N for another one, --every N for many"
    plan["world"] = "the camera's frame"
    if recording.tf_frames:
        plan["world"] += "; --world FRAME for another TF frame"
    missing = ["radius", "bounds"]
    if recording.episodes is not None:
        options.append("--intrinsics FX,FY,CX,CY")
        missing.insert(0, "intrinsics")
        if recording.episodes > 1:
            plan["frames"] += f"; --episode N for one of {recording.episodes} episodes"
    image = first.view is not None and first.view.kind == "depth image"
    plan |= _plan_method(False, False, image) | _plan_radius(None, 1)
    return Advice(_make_command(path, options), tuple(missing), plan)


def _plan_method(masked: bool, bounded: bool, images: bool) -> dict[str, str]:
    """Say which points count as rope, and whether tubes or images answer first."""
    inside = [*(["the bounds"] if bounded else []), *(["the masks"] if masked else [])]
    ropes = f"points inside {' and '.join(inside)}"
    if bounded and not masked:
        ropes += "; if they show a table, the ropes on it"
    if not inside:
        ropes = (
            "no bounds, no masks: strand looks for ropes on a table; without a table, all points count as "
            "rope; --bounds says where ropes are"
        )
    if masked:
        method = "images first, tubes if their answer is doubtful"
    elif bounded or not images:
        method = "tubes first" + (", images if their answer is doubtful" if images else "")
    else:
        method = "images first if there is a table, else tubes"
    return {"ropes": ropes, "method": method}


def _plan_radius(radius: float | None, views: int) -> dict[str, str]:
    if radius is not None:
        return {"radius": f"{radius * 1e3:.3g} mm, from the scene"}
    accuracy = "" if views > 1 else ", to about 10 % from one view"
    return {"radius": f"estimated from the ropes' apparent width{accuracy}; --radius sets it"}


def _make_command(path: Path, options: Sequence[str] = ()) -> str:
    return " ".join(["strand reconstruct", shlex.quote(str(path)), *options])
