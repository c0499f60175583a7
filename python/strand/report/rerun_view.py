"""Show a model and its views in Rerun: depth images, points, chains, crossings and doubts."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from strand._core import StrandError
from strand.report.cameras import make_cameras
from strand.report.drawn_chains import close_path, find_junctions, pick_color
from strand.report.page import place_points
from strand.ropes.model import Model, list_model_crossings
from strand.support.checks import check_clouds, check_path
from strand.support.extras import import_extra
from strand.support.files import write_bytes
from strand.views.view import View, check_views

_CROSSING = (255, 127, 14)  # orange
_JUNCTION = (255, 255, 255)  # white
_DOUBT = (214, 39, 40)  # red
_NEXT_VIEW = (44, 160, 44)  # green
_TRUTH = (32, 32, 32)  # nearly black
_IMAGE_DISTANCE = 0.2  # of a camera's image from the camera, of its distance from the ropes
_POINT_SIZE = 1.5  # radius of a point on the screen, in Rerun's points


def write_recording(
    model: Model, views: Sequence[View], path: str | os.PathLike[str], *, truth: Sequence[ArrayLike] = ()
) -> None:
    """Write a recording for Rerun's viewer; no window opens.

    A model with a stamp is on the timeline `time`; one without is there at all times.

    Parameters
    ----------
    model : Model
        If it has stages, the recording shows the points that strand used, else all points of the views.
    views : sequence of View
        The views of the model, in the same order.
    path : str or path-like
        The `.rrd` file. An existing one is replaced when the new one is complete.
    truth : sequence of (M, 3) array_like of float
        True centrelines in the world frame, metres, to show beside the chains.

    Raises
    ------
    TypeError
        If `views` are not views, or `truth` does not hold floats.
    ValueError
        If the model has another number of poses than views, or a true centreline is not (M, 3) and finite.
    ImportError
        If rerun-sdk is not installed.
    OSError
        If the file cannot be written.
    """
    path, rerun = check_path("path", path), import_extra("rerun")
    recording = rerun.RecordingStream("strand")
    stream = recording.memory_recording()
    _log(rerun, recording, model, views, truth)
    write_bytes(path, stream.drain_as_bytes())


def show(model: Model, views: Sequence[View], *, truth: Sequence[ArrayLike] = ()) -> None:
    """Open Rerun's viewer in a window that stays open after the function returns.

    Parameters
    ----------
    model : Model
        If it has stages, the viewer shows the points that strand used, else all points of the views.
    views : sequence of View
        The views of the model, in the same order.
    truth : sequence of (M, 3) array_like of float
        True centrelines in the world frame, metres, to show beside the chains.

    Raises
    ------
    TypeError, ValueError
        As `write_recording` does.
    strand.StrandError
        If the viewer cannot be started, for example without a display.
    ImportError
        If rerun-sdk is not installed.
    """
    rerun = import_extra("rerun")
    recording = rerun.RecordingStream("strand")
    try:
        recording.spawn()
        _log(rerun, recording, model, views, truth)
        recording.flush()
    except RuntimeError as error:  # without a display, the viewer ends at once
        why = (str(error).splitlines() or [""])[0]
        reason = f"Rerun's viewer cannot be started ({why}); write_recording (--save) needs no display"
        raise StrandError(reason) from error


def _log(rerun: Any, recording: Any, model: Model, views: Sequence[View], truth: Sequence[ArrayLike]) -> None:
    views = check_views(views)
    cameras = make_cameras(model, views)
    lines = check_clouds("truth", truth)
    if model.stamp is not None:
        recording.set_time("time", timestamp=model.stamp)

    def log(name: str, *shapes: Any) -> None:
        recording.log(name, *shapes, static=model.stamp is None)

    nodes = np.vstack([np.zeros((0, 3)), *(chain.points for chain in model.chains)])
    middle = nodes.mean(axis=0) if len(nodes) else np.zeros(3)
    for i, (camera, points) in enumerate(zip(cameras, place_points(model, views), strict=True)):
        log(f"points/{i}", rerun.Points3D(points, radii=rerun.Radius.ui_points(_POINT_SIZE)))
        if camera is None:
            continue
        height, width = camera.depth.shape
        (fx, fy), (cx, cy) = camera.pinhole
        away = float(np.linalg.norm(camera.viewpoint - middle))
        log(f"cameras/{i}", rerun.Transform3D(translation=camera.viewpoint, mat3x3=camera.pose[:3, :3]))
        log(
            f"cameras/{i}",
            rerun.Pinhole(
                image_from_camera=np.array([[fx, 0.0, cx + 0.5], [0.0, fy, cy + 0.5], [0.0, 0.0, 1.0]]),
                resolution=[width, height],
                camera_xyz=rerun.ViewCoordinates.RDF,
                image_plane_distance=_IMAGE_DISTANCE * away,
            ),
        )
        log(f"cameras/{i}/depth", rerun.DepthImage(camera.depth.astype(np.float32), meter=1.0))
    for i, chain in enumerate(model.chains):
        path = close_path(chain)
        color = tuple(bytes.fromhex(pick_color(i)[1:]))
        label = f"chain {i}: {chain.length * 1e3:.0f} mm"
        log(f"chains/{i}", rerun.LineStrips3D([path], radii=chain.radius / 3, colors=[color], labels=[label]))
        if not chain.closed:
            log(
                f"ends/{i}",
                rerun.Points3D(
                    chain.points[[0, -1]], radii=chain.radius, colors=[color], labels=["start", "end"]
                ),
            )
    radius = float(np.median([chain.radius for chain in model.chains])) if model.chains else 0.005
    if len(nodes):
        met = list_model_crossings(model)
        if met:
            places, orders = zip(*((crossing.place, str(crossing)) for crossing in met), strict=True)
            log("crossings", rerun.Points3D(places, radii=radius, colors=[_CROSSING], labels=orders))
    junctions = find_junctions(model)
    if len(junctions):
        log("junctions", rerun.Points3D(junctions, radii=1.2 * radius, colors=[_JUNCTION]))
    unsure = [doubt for doubt in model.doubts if doubt.place is not None]
    if unsure:
        reasons = [f"{doubt.kind}: {doubt.reason}" for doubt in unsure]
        log(
            "doubts",
            rerun.Points3D([d.place for d in unsure], radii=1.5 * radius, colors=[_DOUBT], labels=reasons),
        )
    for i, line in enumerate(lines):
        log(f"truth/{i}", rerun.LineStrips3D([line], radii=radius / 6, colors=[_TRUTH]))
    if model.chains and len(model.poses):
        place = model.next_view(count=1)[0].position
        log("next_view", rerun.Points3D([place], radii=2 * radius, colors=[_NEXT_VIEW], labels=["next view"]))
