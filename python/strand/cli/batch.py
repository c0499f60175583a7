"""`strand batch`: a table of the ropes of many recordings."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path

from strand.batch import Settings, write_summary
from strand.batch.running import ENGINES, Counts
from strand.batch.running import run as run_batch
from strand.batch.settings import RATE
from strand.cli import values
from strand.cli.arguments import collect_arguments
from strand.cli.inputs import collect_settings
from strand.cli.options import add_branches, add_camera, add_deadline, add_recording, add_ropes
from strand.cli.terminal import print_message
from strand.io.budget import MAX_BYTES
from strand.support.checks import check_integer
from strand.support.files import require_writable

DESCRIPTION = """\
Reconstruct the ropes of many recordings, and write a folder of Parquet files
with one row per rope. Finished work is skipped. A recording that is broken
becomes a row with its error. With --track, ropes keep their numbers from frame
to frame of a recording."""

_PERIOD = 10.0  # seconds between two lines about the progress


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "recordings",
        type=values.parse_path,
        nargs="+",
        metavar="PATH",
        help="a scene's folder; an .npz, .bag, .mcap or .db3 file; a ROS 2 bag's folder; a folder of depth "
        "images; a single file of one view; or a folder to search for these",
    )
    command.add_argument(
        "-o",
        "--out",
        type=values.parse_path,
        required=True,
        metavar="OUT",
        help="the folder of Parquet files",
    )
    command.add_argument(
        "--engine",
        choices=ENGINES,
        default="local",
        help="work with processes of this machine, or on a Ray cluster (default: local)",
    )
    command.add_argument(
        "--address", metavar="HOST:PORT", help="the Ray cluster (default: start Ray on this machine)"
    )
    command.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="number of recordings to work on at once (default: one per core); a cluster uses its own number",
    )
    command.add_argument(
        "--threads", type=int, default=1, metavar="N", help="number of threads per worker (default: 1)"
    )
    command.add_argument(
        "--stretch",
        type=int,
        metavar="N",
        help="split long recordings into stretches of N frames (default: whole recordings); with --world or "
        "several topics each stretch reads the whole recording, so choose a tenth of it or more",
    )
    command.add_argument(
        "--every", type=int, default=1, metavar="N", help="take every Nth frame of a recording (default: 1)"
    )
    command.add_argument(
        "--track",
        action="store_true",
        help="follow the ropes through the frames of each recording with a tracker, as `strand track` does; "
        "the scenes of a folder are then the frames of one recording",
    )
    command.add_argument(
        "--rate",
        type=float,
        metavar="HZ",
        help=f"with --track, frames per second of folders, which have no times (default: {RATE:g})",
    )
    command.add_argument(
        "--root",
        type=values.parse_path,
        metavar="DIR",
        help="the folder that the recordings' names are relative to (default: that of the last run with this "
        "OUT, else the current folder)",
    )
    command.add_argument(
        "--retry-errors", action="store_true", help="repeat work that ended in an error (default: keep it)"
    )
    command.add_argument(
        "--summary", type=values.parse_path, metavar="PAGE", help="also write an HTML page about the table"
    )
    # --max-bytes is a setting of the recordings: other values repeat all work
    command.add_argument(
        "--summary-max-bytes",
        type=int,
        default=MAX_BYTES,
        metavar="N",
        help=f"half of the memory that the page may take for a Parquet file, bytes (default: {MAX_BYTES})",
    )
    add_camera(command)
    add_recording(command.add_argument_group("recordings"))
    add_ropes(command)
    add_deadline(command)
    add_branches(command)


def run(options: argparse.Namespace) -> None:
    """Reconstruct recordings, and print what was done."""
    if options.summary is not None:
        check_integer("--summary-max-bytes", options.summary_max_bytes, 1)
        _check_summary(options.summary, options.out)
        require_writable(options.summary)
    # Ray prints messages of its tasks to stdout
    with _print_progress() as show, redirect_stdout(sys.stderr):
        done = run_batch(
            options.recordings,
            options.out,
            Settings(
                **collect_arguments(options),
                **collect_settings(options),
                stretch=options.stretch,
                track=options.track,
                rate=options.rate,
                viewpoint=options.viewpoint,
                camera_frame=options.camera_frame,
            ),
            engine=options.engine,
            workers=options.workers,
            threads=options.threads,
            address=options.address,
            root=options.root,
            retry_errors=options.retry_errors,
            progress=show,
        )
    print(f"made     {done.made} units, {done.rows} rows, {done.errors} of them errors")
    print(f"skipped  {done.skipped} finished units")
    if done.replaced:
        print(f"replaced {done.replaced} units of other files, settings or versions")
    if done.kept:
        print(f"kept     {done.kept} recordings that cannot be read now")
    print(options.out)
    if options.summary is not None:
        write_summary(options.out, options.summary, max_bytes=options.summary_max_bytes)
        print(options.summary)


def _check_summary(page: Path, out: Path) -> None:
    """Refuse a page in the place of the table's folder or of a parent folder."""
    folder = Path(os.path.realpath(out))
    if Path(os.path.realpath(page)) in (folder, *folder.parents):
        raise ValueError(f"--summary: expected a file outside of the folder {out} (-o), got {page}")


@contextmanager
def _print_progress() -> Iterator[Callable[[Counts], None]]:
    """Print the progress to stderr every few seconds; the yielded function takes the latest counts."""
    begun, latest, ended = time.monotonic(), Counts(), threading.Event()

    def show(counts: Counts) -> None:
        nonlocal latest
        latest = counts

    def print_lines() -> None:
        while not ended.wait(_PERIOD):
            rate = latest.made / (time.monotonic() - begun)
            words = f"{latest.made} made, {latest.skipped} skipped, {latest.errors} errors"
            print_message(f"strand: {words}, {rate:.1f} per second")

    lines = threading.Thread(target=print_lines, daemon=True)
    lines.start()
    try:
        yield show
    finally:
        ended.set()
        lines.join()
