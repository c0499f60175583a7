"""The command line: `strand demo` and `strand reconstruct`. Arguments and lines of text only."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from importlib.util import find_spec
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np

import strand
from strand import config
from strand.checks import Array, Bounds
from strand.files import extra, replacing, require_writable
from strand.io.budget import MAX_BYTES
from strand.io.description import parse_length
from strand.io.recordings import Frame, is_recording
from strand.io.recordings.recording import TOLERANCE
from strand.io.scenes import load_scene
from strand.model import content
from strand.report import figures, tables

_OF_RECORDINGS = ("topic", "frame", "every", "world", "tolerance", "depth_scale", "ignore_distortion")

EXIT_CODES = """\
exit codes:
  0    done
  1    the data do not support an answer; a file is damaged, not what it should be, or too large
  2    wrong arguments, or values that are not accepted
  3    a file is missing, or cannot be read or written; or an optional package is not installed
  130  interrupted
  141  nobody reads the output any more
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name; those of this process if not given.

    Returns
    -------
    int
        The exit code, see `EXIT_CODES`.

    Raises
    ------
    SystemExit
        From argparse: with 2 for wrong usage, with 0 after `--help` and `--version`.
    """
    _open_closed_streams()
    try:
        options = _parser().parse_args(arguments)
        options.run(options)
        code = 0
    except SystemExit as error:  # help is printed, which may fail as all that is printed
        code = _flushed(error.code if isinstance(error.code, int) else 2)
        raise SystemExit(code) from None
    except BaseException as error:
        code = _code_of(error)
    return _flushed(code)


def _code_of(error: BaseException) -> int:
    """Say what was wrong, and return the exit code; what no one expects is raised again."""
    match error:
        case BrokenPipeError():
            return 141
        case KeyboardInterrupt():
            return _fail("interrupted", 130)
        case MemoryError():
            return _fail("out of memory", 1)
        case strand.StrandError():
            return _fail(error, 1)
        case ValueError() | TypeError():
            return _fail(error, 2)
        case OSError():
            return _fail(f"{error.filename}: {error.strerror}" if error.filename else error, 3)
        case ImportError():
            return _fail(error, 3)
    raise error


def _flushed(code: int) -> int:
    """Print what is left to print, and return the exit code: of an error of that if there was none."""
    try:
        sys.stdout.flush()
    except OSError as error:
        # what is left in the buffer would fail once more when Python exits
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return code or _code_of(error)
    return code


def _open_closed_streams() -> None:
    """Make standard streams that the caller closed lead nowhere, and stdout print any file's name."""
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="strand",
        description="Ordered 3D centrelines of strings, ropes, cables and hoses from depth-camera data.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"strand {strand.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    demo = commands.add_parser(
        "demo",
        help="a simulated rope by both methods, compared with the truth",
        description="Simulate the published experiment (one string, seven views), reconstruct it by the "
        "default and by the published method, and compare both with the truth.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    demo.add_argument(
        "--out",
        type=_path,
        default=Path("strand-demo"),
        metavar="DIR",
        help="where model.json and the figures go (default: %(default)s)",
    )
    demo.add_argument(
        "--seed", type=int, default=0, help="seed of the simulated noise (default: %(default)s)"
    )
    demo.set_defaults(run=_demo)

    reconstruct = commands.add_parser(
        "reconstruct",
        help="ropes of a recorded scene",
        description="Reconstruct the ropes of a scene, or of frames of a recording.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    reconstruct.add_argument(
        "scene",
        type=_path,
        metavar="SCENE",
        help="a folder with a scene.toml, an .npz file, or a recording: a .bag, .mcap or .db3 file, or the "
        "folder of a ROS 2 bag",
    )
    reconstruct.add_argument(
        "-o",
        "--out",
        type=_path,
        metavar="MODEL",
        help="the JSON file to write; with --every, one line of JSON for each frame (default: none)",
    )
    reconstruct.add_argument(
        "--radius",
        type=_length,
        metavar="LENGTH",
        help="the ropes' radius, such as 4.2mm (default: the scene's; estimated if it has none)",
    )
    reconstruct.add_argument(
        "--ropes", type=int, metavar="N", help="how many there are (default: as many as the data show)"
    )
    reconstruct.add_argument(
        "--length",
        type=_length,
        nargs="+",
        metavar="LENGTH",
        help="how long they are, such as 0.4m: one length for all, or one for each (default: not known)",
    )
    reconstruct.add_argument(
        "--bounds",
        type=_length,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="extraction range in the world frame, low and high corner, metres (default: the scene's)",
    )
    reconstruct.add_argument(
        "--mask",
        type=_path,
        nargs="+",
        metavar="PATH",
        help="where the ropes are in each depth image: a PNG or NPY file for each view; 0 is no rope, other "
        "numbers are ropes or pieces of them (default: the scene's)",
    )
    reconstruct.add_argument(
        "--config", type=_path, metavar="FILE", help="a TOML file with the method's numbers"
    )
    reconstruct.add_argument(
        "--max-bytes",
        type=int,
        default=MAX_BYTES,
        metavar="N",
        help=f"how much memory the scene's files may take (default: {MAX_BYTES})",
    )
    reconstruct.add_argument(
        "--outside",
        action="store_true",
        help="let the scene.toml name files outside of its folder, which may be any of yours",
    )
    reconstruct.add_argument(
        "--deadline",
        type=float,
        metavar="SECONDS",
        help="leave out what an answer can do without after this time (default: never)",
    )
    reconstruct.add_argument("--figures", type=_path, metavar="DIR", help="draw every stage into this folder")
    _add_recording_options(reconstruct.add_argument_group("recordings"))
    # lengths such as -4mm are values, not options
    reconstruct._negative_number_matcher = re.compile(r"^-\.?\d")
    reconstruct.set_defaults(run=_reconstruct)
    return parser


def _add_recording_options(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--topic",
        nargs="+",
        metavar="TOPIC",
        help="topics with depth, one a camera; * stands for any text (default: the only one with depth)",
    )
    group.add_argument(
        "--frame", type=int, metavar="N", help="which frame, or the first of several, from 0 (default: 0)"
    )
    group.add_argument(
        "--every", type=int, metavar="N", help="this frame and every Nth after it (default: one frame)"
    )
    group.add_argument(
        "--world",
        metavar="FRAME",
        help="the TF frame that is the world frame (default: the frame of the only camera)",
    )
    group.add_argument(
        "--tolerance",
        type=float,
        metavar="SECONDS",
        help=f"how far apart in time the cameras' images may be (default: {TOLERANCE})",
    )
    group.add_argument(
        "--depth-scale",
        type=float,
        metavar="METRES",
        help="a unit of depth images of 16 bits (default: what the recording says, else 0.001)",
    )
    group.add_argument(
        "--ignore-distortion", action="store_true", help="take images of lenses that distort as they are"
    )


def _demo(options: argparse.Namespace) -> None:
    made = strand.synthetic.scene("paper", seed=options.seed)
    methods = {
        "default": (strand.Config(), options.out),
        "published": (strand.Config.published(), options.out / "published"),
    }
    written = []
    for name, (settings, folder) in methods.items():
        with _progress(len(tables.STAGE_ARRAYS[settings.method])) as progress:
            model = strand.reconstruct(
                made.views,
                radius=made.radius,
                bounds=made.bounds,
                ropes=1,
                config=settings,
                keep_stages=True,
                progress=progress,
            )
        _warn(model)
        print(f"The {name} method", end="\n\n")
        print(tables.describe_stages(made.views, model), end="\n\n")
        print(tables.describe_counts(model), end="\n\n")
        print(tables.describe_accuracy(model, made.truth), end="\n\n")
        folder.mkdir(parents=True, exist_ok=True)
        model.save(folder / "model.json")
        written += [folder / "model.json", *figures.write_figures(model, folder, made.truth)]
    for path in written:
        print(path)


def _reconstruct(options: argparse.Namespace) -> None:
    if is_recording(options.scene):
        _reconstruct_recording(options)
        return
    for option in _OF_RECORDINGS:
        if (given := vars(options)[option]) is not None and given is not False:
            raise ValueError(
                f"--{option.replace('_', '-')}: for recordings only, and {options.scene} is none"
            )
    recorded = load_scene(options.scene, options.mask, max_bytes=options.max_bytes, outside=options.outside)
    _check_outputs(options, recorded.files)
    known = _known(options, recorded.radius, recorded.bounds)
    _reconstruct_once(options, recorded.views, known, recorded.truth)


def _reconstruct_recording(options: argparse.Namespace) -> None:
    if options.mask is not None:
        raise ValueError("--mask: for scenes only; a recording has one image after the other")
    with strand.Recording(
        options.scene,
        options.topic,
        world=options.world,
        tolerance=TOLERANCE if options.tolerance is None else options.tolerance,
        depth_scale=options.depth_scale,
        ignore_distortion=options.ignore_distortion,
        max_bytes=options.max_bytes,
    ) as recording:
        _check_outputs(options, recording.files)
        known = _known(options)
        start = options.frame or 0
        if options.every is not None:
            _reconstruct_frames(options, recording.read(start, None, options.every), known)
            return
        frame = next(recording.read(start, start + 1), None)
        if frame is None:
            raise ValueError(f"--frame: expected less than the recording's {len(recording)}, got {start}")
        _reconstruct_once(options, frame.views, known)


def _reconstruct_frames(options: argparse.Namespace, frames: Iterator[Frame], known: dict[str, Any]) -> None:
    """Print a line for each frame, and write one with its model, or with why there is none."""
    if options.figures is not None:
        raise ValueError("--figures: of one frame only, and --every asks for several")
    previous, count = None, 0
    with nullcontext() if options.out is None else replacing(options.out) as file:
        for frame in frames:
            count += 1
            said: dict[str, object] = {"frame": frame.number, "stamp": frame.stamp}
            try:
                previous = strand.reconstruct(frame.views, **known, previous=previous)
            except strand.NotEnoughDataError as error:
                said["error"] = shown = str(error)
            else:
                _warn(previous, f"frame {frame.number}: ")
                said["model"] = content(previous)
                shown = tables.describe_frame(previous)
            print(f"frame {frame.number} at {frame.time:.3f} s: {shown}", flush=True)
            if file is not None:
                file.write(json.dumps(said, allow_nan=False).encode() + b"\n")
        if previous is None:
            raise strand.NotEnoughDataError(f"none of {count} frames supports an answer")
    if options.out is not None:
        print(options.out)


def _known(
    options: argparse.Namespace, radius: float | None = None, bounds: Bounds | None = None
) -> dict[str, Any]:
    """Arguments of a reconstruction: what the command line says, or else the scene."""
    if options.bounds is not None:
        bounds = np.array(options.bounds[:3]), np.array(options.bounds[3:])
    return {
        "radius": radius if options.radius is None else options.radius,
        "bounds": bounds,
        "ropes": options.ropes,
        "length": options.length[0] if options.length and len(options.length) == 1 else options.length,
        "config": strand.Config() if options.config is None else config.load(options.config),
        "deadline": options.deadline,
    }


def _reconstruct_once(
    options: argparse.Namespace,
    views: Sequence[strand.View],
    known: dict[str, Any],
    truth: Sequence[Array] = (),
) -> None:
    stages = set(tables.STAGE_ARRAYS[known["config"].method])
    if known["radius"] is not None:
        stages.discard("radius")
    with _progress(len(stages)) as progress:
        model = strand.reconstruct(views, **known, keep_stages=options.figures is not None, progress=progress)
    _warn(model)
    if known["radius"] is None and model.chains:
        print(f"radius: {model.chains[0].radius * 1e3:.2f} mm, estimated from the points", end="\n\n")
    print(tables.describe_chains(model), end="\n\n")
    print(tables.describe_timings(model), end="\n\n")
    if options.out is not None:
        model.save(options.out)
        print(options.out)
    if options.figures is not None:
        for path in figures.write_figures(model, options.figures, truth):
            print(path)


def _check_outputs(options: argparse.Namespace, files: Sequence[Path]) -> None:
    """Refuse what cannot be written, before there is anything to write."""
    _keep_input(files if options.config is None else (*files, options.config), options.out, options.figures)
    if options.out is not None:
        require_writable(options.out)


def _keep_input(read: Sequence[Path], out: Path | None, drawn: Path | None) -> None:
    """Refuse to write the model, or a figure, over a file that was read.

    Raises
    ------
    ValueError
        If it would.
    """
    kept = {os.path.realpath(path) for path in read}
    written = {} if out is None else {"--out": [out]}
    if drawn is not None and drawn.is_dir():
        written["--figures"] = list(drawn.glob("[0-9]-*.png"))
    for option, paths in written.items():
        for path in paths:
            if os.path.realpath(path) in kept:
                raise ValueError(f"{option}: {path} is part of the scene or the configuration")


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("expected a path, got an empty text")
    return Path(text)


def _length(text: str) -> float:
    try:
        return parse_length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


@contextmanager
def _progress(stages: int) -> Iterator[Callable[[str], None]]:
    """Show so many stages on stderr as they start: a bar on a terminal, lines elsewhere or without rich."""
    if not sys.stderr.isatty() or find_spec("rich") is None:
        yield lambda stage: _say(f"strand: {stage}")
        return
    console = extra("rich.console").Console(stderr=True)
    rich = extra("rich.progress")
    columns = (rich.SpinnerColumn(), rich.TextColumn("{task.description:<10}"), rich.BarColumn())
    with rich.Progress(*columns, console=console, transient=True) as display:
        task = display.add_task("", total=stages, completed=-1)
        yield lambda stage: display.update(task, description=stage, advance=1)


def _warn(model: strand.Model, about: str = "") -> None:
    for warning in model.warnings:
        _say(f"strand: warning: {about}{warning}")


def _fail(error: object, code: int) -> int:
    _say(f"strand: error: {' '.join(str(error).split())}")
    return code


def _say(line: str) -> None:
    """Print a line to stderr; that it may be full is no reason to stop."""
    with suppress(OSError):
        print(line, file=sys.stderr, flush=True)
