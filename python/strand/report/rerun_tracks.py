"""Show tracked ropes in Rerun, with a timeline: ropes, predicted parts, ends, points and events."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from strand.report.drawn_chains import pick_color
from strand.report.tracks import Track, TrackedRope, check_tracks, cut_rope, name_rope
from strand.support.checks import Array, check_clouds, check_path
from strand.support.extras import import_extra
from strand.support.files import write_bytes

_HIDDEN = (138, 138, 138)  # grey: predicted parts
_POINT = (200, 200, 200)  # light grey: points of the ropes' pixels
_POINT_SIZE = 1.0  # radius of a point on the screen, in Rerun's points


def write_track_recording(
    tracks: Sequence[Track],
    path: str | os.PathLike[str],
    *,
    numbers: Sequence[int] | None = None,
    clouds: Sequence[Array] | None = None,
) -> None:
    """Write a recording of tracked ropes for Rerun's viewer, with the timelines `time` and `frame`.

    Parameters
    ----------
    tracks : sequence of Track
        The answers of a `strand.Tracker`, in order. The first one is at time 0.
    path : str or path-like
        The `.rrd` file. An existing one is replaced when the new one is complete.
    numbers : sequence of int, optional
        The frames' numbers; by default from 0 on.
    clouds : sequence of (N, 3) ndarray, optional
        Points to show with each track, world frame, metres.

    Raises
    ------
    ValueError
        If there is another number of numbers or clouds than tracks.
    ImportError
        If rerun-sdk is not installed.
    OSError
        If the file cannot be written.
    """
    path = check_path("path", path)
    tracks, numbers = check_tracks(tracks, numbers)
    points = None if clouds is None else check_clouds("clouds", clouds)
    if points is not None and len(points) != len(tracks):
        raise ValueError(f"clouds: expected one for each of {len(tracks)} tracks, got {len(points)}")
    rerun = import_extra("rerun")
    recording = rerun.RecordingStream("strand")
    stream = recording.memory_recording()
    for k, track in enumerate(tracks):
        recording.set_time("time", duration=track.time - tracks[0].time)
        recording.set_time("frame", sequence=numbers[k])
        if points is not None:
            sizes = rerun.Radius.ui_points(_POINT_SIZE)
            recording.log("points", rerun.Points3D(points[k], radii=sizes, colors=[_POINT]))
        for rope in track.ropes:
            _log_rope(rerun, recording, rope)
        gone = (
            {rope.number for rope in tracks[k - 1].ropes} - {rope.number for rope in track.ropes} if k else ()
        )
        for number in gone:
            recording.log(f"ropes/{number}", rerun.Clear(recursive=True))
        for event in track.events:
            recording.log("events", rerun.TextLog(str(event)))
    write_bytes(path, stream.drain_as_bytes())


def _log_rope(rerun: Any, recording: Any, rope: TrackedRope) -> None:
    color, name = tuple(bytes.fromhex(pick_color(rope.number)[1:])), f"ropes/{rope.number}"
    shown, hidden = (cut_rope(rope, predicted) for predicted in (False, True))
    label = f"{name_rope(rope)}, {rope.state}"
    recording.log(f"{name}/line", rerun.LineStrips3D(shown, radii=rope.radius / 3, colors=[color]))
    recording.log(f"{name}/predicted", rerun.LineStrips3D(hidden, radii=rope.radius / 6, colors=[_HIDDEN]))
    recording.log(
        f"{name}/ends",
        rerun.Points3D(rope.points[[0, -1]], radii=rope.radius, colors=[color], labels=[label, "last end"]),
    )
