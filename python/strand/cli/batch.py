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
from strand.batch.running import ENGINES, Done
from strand.batch.running import run as run_batch
from strand.cli import values
from strand.cli.inputs import matrix_of
from strand.cli.options import add_camera, add_recording, add_ropes
from strand.cli.outcome import say
from strand.cli.solving import known
from strand.io.recordings.recording import TOLERANCE
from strand.support.files import require_writable

HINT = "a table of the ropes of many recordings"
DESCRIPTION = """\
Reconstruct the ropes of many recordings, and write a folder of Parquet files
with a row for each rope. What is there already is not made again, and a
recording that is broken is a row with its error."""

# seconds from one line about what was done to the next
_EVERY = 10.0


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's words."""
    command.add_argument(
        "recordings",
        type=values.path,
        nargs="+",
        metavar="PATH",
        help="a scene's folder, an .npz, .bag, .mcap or .db3 file, the folder of a ROS 2 bag, a folder of "
        "depth images, a single file of one view; or a folder in which these are sought",
    )
    command.add_argument(
        "-o", "--out", type=values.path, required=True, metavar="OUT", help="the folder of Parquet files"
    )
    command.add_argument(
        "--engine",
        choices=ENGINES,
        default="local",
        help="who works: processes of this machine, or a Ray cluster (default: local)",
    )
    command.add_argument(
        "--address", metavar="HOST:PORT", help="of a Ray cluster; Ray is started on this machine if not given"
    )
    command.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="how many recordings are worked on at once (default: one for each core); nothing to a cluster, "
        "which has its own number",
    )
    command.add_argument(
        "--threads", type=int, default=1, metavar="N", help="how many threads each has (default: 1)"
    )
    command.add_argument(
        "--stretch",
        type=int,
        metavar="N",
        help="work on long recordings in stretches of so many frames (default: whole recordings); a tenth of "
        "a recording or more with --world or several topics, as each stretch looks through all of it then",
    )
    command.add_argument(
        "--every", type=int, default=1, metavar="N", help="take every Nth frame of a recording (default: 1)"
    )
    command.add_argument(
        "--root",
        type=values.path,
        metavar="DIR",
        help="the folder below which recordings are named (default: that of the last time with this OUT; the "
        "first time, the current one)",
    )
    command.add_argument(
        "--retry-errors", action="store_true", help="make again what holds errors (default: keep it)"
    )
    command.add_argument(
        "--summary", type=values.path, metavar="PAGE", help="also write an HTML page about the whole table"
    )
    add_camera(command)
    add_recording(command.add_argument_group("recordings"))
    add_ropes(command)


def run(options: argparse.Namespace) -> None:
    """Reconstruct recordings, and say what was done."""
    if options.summary is not None:
        _require_apart(options.summary, options.out)
        require_writable(options.summary)
    # Ray prints what became of its tasks
    with _shown() as show, redirect_stdout(sys.stderr):
        done = run_batch(
            options.recordings,
            options.out,
            _settings(options),
            engine=options.engine,
            workers=options.workers,
            threads=options.threads,
            address=options.address,
            root=options.root,
            retry_errors=options.retry_errors,
            progress=show,
        )
    print(f"made     {done.made} units, {done.rows} rows, {done.errors} of them errors")
    print(f"skipped  {done.skipped} units that were there")
    if done.replaced:
        print(f"replaced {done.replaced} units of other files, settings or versions")
    if done.kept:
        print(f"kept     {done.kept} recordings as they were: they cannot be read now")
    print(options.out)
    if options.summary is not None:
        write_summary(options.out, options.summary)
        print(options.summary)


def _require_apart(page: Path, out: Path) -> None:
    """Refuse a page in the place of a folder that the table needs."""
    folder = Path(os.path.realpath(out))
    if Path(os.path.realpath(page)) in (folder, *folder.parents):
        raise ValueError(
            f"--summary: expected a file apart from the folder of -o, got --summary {page} and -o {out}"
        )


def _settings(options: argparse.Namespace) -> Settings:
    return Settings(
        **known(options),
        every=options.every,
        stretch=options.stretch,
        topics=options.topic,
        world=options.world,
        tolerance=TOLERANCE if options.tolerance is None else options.tolerance,
        ignore_distortion=options.ignore_distortion,
        intrinsics=matrix_of(options.intrinsics),
        depth_scale=options.depth_scale,
        viewpoint=options.viewpoint,
        camera_frame=options.camera_frame,
        max_bytes=options.max_bytes,
        outside=options.outside,
    )


@contextmanager
def _shown() -> Iterator[Callable[[Done], None]]:
    """Say every few seconds on stderr what was done so far, also while no unit ends."""
    begun, done, ended = time.monotonic(), Done(), threading.Event()

    def show(now: Done) -> None:
        nonlocal done
        done = now

    def say_all() -> None:
        while not ended.wait(_EVERY):
            rate = done.made / (time.monotonic() - begun)
            say(
                f"strand: {done.made} made, {done.skipped} skipped, {done.errors} errors, {rate:.1f} a second"
            )

    lines = threading.Thread(target=say_all, daemon=True)
    lines.start()
    try:
        yield show
    finally:
        ended.set()
        lines.join()
