"""`strand track`: the same ropes through the frames of a recording."""

from __future__ import annotations

import argparse
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import strand
from strand.batch.following import Follower, find_times, mask_frame
from strand.batch.rope_columns import POINTS, RopeColumns
from strand.batch.rows import make_model_rows, make_unanswered_row
from strand.batch.settings import RATE
from strand.batch.table import Row
from strand.batch.writing import write_rows
from strand.cli import values
from strand.cli.inputs import describe_missing_frame
from strand.cli.options import add_episode, add_pinhole, add_recording, add_ropes
from strand.cli.outputs import protect_inputs
from strand.cli.terminal import flush_before_message, print_message
from strand.cli.track_frames import FrameSource, require_depth
from strand.io.lerobot.layout import is_data_set
from strand.report.drawn_points import choose_points
from strand.report.rerun_tracks import write_track_recording
from strand.report.scene_updates import write_mcap
from strand.report.track_page import write_track_report
from strand.ropes.summary import format_confidence
from strand.support.checks import Array
from strand.support.extras import import_extra
from strand.support.files import check_suffix, replace_file, require_writable
from strand.tracking.track import Track

_MOST_POINTS = 20_000  # of a frame that Rerun shows

DESCRIPTION = """\
Follow the same ropes through the frames of a recording, and write a Parquet
file with one row per rope and frame, a page that plays them, or a recording
for Rerun or Foxglove. Frames without masks get them from depth and colour, as in
`strand reconstruct`. A frame that is damaged becomes a row with its error.
For many recordings, use `strand batch --track`."""


@dataclass(eq=False)
class _Film:
    """The answers for pictures."""

    numbers: list[int] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
    clouds: list[Array] = field(default_factory=list)


@dataclass(eq=False)
class _Counts:
    """Numbers of frames, and the last answer."""

    frames: int = 0
    failed: int = 0
    bare: int = 0
    seconds: float = 0.0
    last: Track | None = None


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "recording",
        type=values.parse_path,
        metavar="RECORDING",
        help="a .bag, .mcap or .db3 file; the folder of a ROS 2 bag or LeRobot data set; a folder of depth "
        "images; or a folder of scenes (.npz files, folders with a scene.toml), one for each frame, in the "
        "order of their names",
    )
    command.add_argument(
        "-o", "--out", type=values.parse_path, metavar="TRACKS", help="write this .parquet file"
    )
    command.add_argument(
        "--report", type=values.parse_path, metavar="PAGE", help="write an HTML page that plays the ropes"
    )
    command.add_argument(
        "--rerun", type=values.parse_path, metavar="FILE", help="write this .rrd file for the viewer Rerun"
    )
    command.add_argument(
        "--mcap", type=values.parse_path, metavar="FILE", help="write this .mcap file for the viewer Foxglove"
    )
    command.add_argument(
        "--lerobot",
        type=values.parse_path,
        metavar="OUT",
        help="write a copy of a LeRobot data set with the ropes of each frame as features, into a new folder",
    )
    command.add_argument(
        "--points",
        type=int,
        metavar="N",
        help=f"points of a rope with --lerobot (default: {POINTS})",
    )
    command.add_argument(
        "--frame", type=int, default=0, metavar="N", help="number of the first frame, from 0 (default: 0)"
    )
    command.add_argument(
        "--every", type=int, default=1, metavar="N", help="take every Nth frame (default: 1)"
    )
    command.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help=f"frames per second of a folder, which has no times (default: {RATE:g})",
    )
    for name, what in (
        ("mask", "masks of the ropes, as for `strand reconstruct`"),
        ("color", "colour images"),
        ("occluders", "pixels of the robot or a hand"),
    ):
        command.add_argument(
            f"--{name}",
            type=values.parse_path,
            metavar="DIR",
            help=f"a folder with {what}, one for each of a folder's depth images and of the same name",
        )
    add_pinhole(command)
    recordings = command.add_argument_group("recordings")
    add_recording(recordings)
    add_episode(recordings)
    add_ropes(command)


def run(options: argparse.Namespace) -> None:
    """Follow the ropes, print what happens, and write the requested files."""
    _import_packages(options)
    source = FrameSource(options)
    _check_outputs(options, source)
    pictures = (options.report, options.rerun, options.mcap)
    film = None if all(path is None for path in pictures) else _Film()
    columns = _start_columns(options)
    counts = _Counts()
    rows = _follow(options, source, counts, film, columns)
    if options.out is None:
        deque(rows, maxlen=0)
    else:
        with replace_file(options.out) as file:
            write_rows(rows, file, source.settings.digest)
    if columns is not None:
        columns.write()
    _print_summary(counts)
    if options.out is not None:
        print(options.out)
    if film is not None and options.report is not None:
        name = options.recording.absolute().name
        write_track_report(film.tracks, options.report, title=name, numbers=film.numbers)
        print(options.report)
    if film is not None and options.rerun is not None:
        write_track_recording(film.tracks, options.rerun, numbers=film.numbers, clouds=film.clouds)
        print(options.rerun)
    if film is not None and options.mcap is not None:
        write_mcap((track.model for track in film.tracks), options.mcap, frame_id=source.frame_id)
        print(options.mcap)
    if columns is not None:
        print(options.lerobot)


def _start_columns(options: argparse.Namespace) -> RopeColumns | None:
    """Return the columns of a new data set, checked before the work; None without --lerobot."""
    if options.lerobot is None:
        if options.points is not None:
            raise ValueError("--points: only with --lerobot, for its features")
        return None
    if not is_data_set(options.recording):
        raise ValueError(f"--lerobot: for LeRobot data sets only, and {options.recording} is none")
    points = POINTS if options.points is None else options.points
    return RopeColumns(
        options.recording, options.lerobot, points=points, ropes=options.ropes, max_bytes=options.max_bytes
    )


def _import_packages(options: argparse.Namespace) -> None:
    """Report a missing package before the work."""
    for path, package in (
        (options.out, "pyarrow.parquet"),
        (options.report, "plotly.offline"),
        (options.rerun, "rerun"),
    ):
        if path is not None:
            import_extra(package)


def _check_outputs(options: argparse.Namespace, source: FrameSource) -> None:
    outputs = {f"--{name}": vars(options)[name] for name in ("out", "report", "rerun", "mcap")}
    given = {option: path for option, path in outputs.items() if path is not None}
    pictures = [option for option in given if option != "--out"]
    if pictures and len(source.starts) > 1:
        raise ValueError(f"{pictures[0]}: shows one episode; --episode N chooses it")
    if not given:
        if options.lerobot is not None:
            return
        raise ValueError("expected at least one of --out, --report, --rerun, --mcap and --lerobot, got none")
    inputs = (
        *source.files,
        *(path for path in (options.config, options.intrinsics) if isinstance(path, Path)),
    )
    protect_inputs(inputs, outputs)
    if len({path.resolve() for path in given.values()}) < len(given):
        raise ValueError(f"{', '.join(given)}: expected different files, got one of them twice")
    if options.out is not None:
        check_suffix(options.out, ("parquet",))
    if options.mcap is not None:
        check_suffix(options.mcap, ("mcap",))
    for path in given.values():
        require_writable(path)


def _follow(
    options: argparse.Namespace,
    source: FrameSource,
    counts: _Counts,
    film: _Film | None,
    columns: RopeColumns | None,
) -> Iterator[Row]:
    """Follow the ropes through all frames, print events, and yield the rows of the table."""
    follower = Follower(source.settings)
    first_error: Exception | None = None
    for number, read in source:
        counts.frames += 1
        if number in source.starts:
            follower = Follower(source.settings)
        begun = time.perf_counter()
        try:
            frame = read()
        except (strand.StrandError, OSError) as error:
            first_error = first_error or error
            yield _report_failed(source, counts, number, None, begun, error)
            continue
        require_depth(options.recording, frame)
        times = find_times(number, frame, source.settings)
        updated = time.perf_counter()
        try:
            masked = mask_frame(frame, source.settings)
            track = follower.update(number, masked)
        except (strand.StrandError, ValueError) as error:
            first_error = first_error or error
            yield _report_failed(source, counts, number, max(times), begun, error)
            continue
        now = time.perf_counter()
        counts.seconds += now - updated
        counts.last = track
        counts.bare += not track.ropes
        for event in track.events:
            print(f"frame {number} at {event}", flush=True)
        if options.out is not None:
            yield from make_model_rows(source.recording, number, track.time, track.model, now - begun, track)
        if columns is not None:
            columns.add(number, track.model)
        if film is not None:
            film.numbers.append(number)
            film.tracks.append(track)
            if options.rerun is not None:
                points = np.concatenate([view.world_points for view in masked.views])
                film.clouds.append(choose_points(points, track.model, _MOST_POINTS).astype(np.float32))
    if counts.last is None and first_error is not None:
        raise first_error
    if not counts.frames and options.frame:
        raise ValueError(describe_missing_frame(options.frame, *source.count_frames()))
    if counts.bare + counts.failed == counts.frames:
        reason = counts.last.reason if counts.last is not None else ""
        why = f"; the last one: {reason}" if reason else ""
        raise strand.NotEnoughDataError(f"none of {counts.frames} frames supports an answer{why}")


def _report_failed(
    source: FrameSource, counts: _Counts, number: int, at: float | None, begun: float, error: Exception
) -> Row:
    """Print why a frame has no answer, and return its row."""
    counts.failed += 1
    flush_before_message()
    print_message(f"strand: warning: frame {number}: {error}")
    return make_unanswered_row(source.recording, number, at, time.perf_counter() - begun, error)


def _print_summary(counts: _Counts) -> None:
    """Print the numbers of frames, and the ropes as the last frame has them."""
    worked = counts.frames - counts.failed
    words = f"{worked} frames, {1e3 * counts.seconds / worked:.1f} ms each"
    for count, what in ((counts.bare, "without a rope"), (counts.failed, "with an error")):
        words += f", {count} {what}" if count else ""
    print(f"\n{words}")
    for rope in counts.last.ropes if counts.last is not None else ():
        print(
            f"rope {rope.number}: {1e3 * rope.length:.1f} ± {1e3 * rope.length_sd:.1f} mm, {rope.state}, "
            f"seen {100 * rope.seen.mean():.0f} %, confidence {format_confidence(rope.confidence)}"
        )
    print()
