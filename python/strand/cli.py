"""The command line: `strand demo`, `reconstruct`, `report` and `view`. Arguments and lines of text only."""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from importlib.util import find_spec
from io import TextIOWrapper
from pathlib import Path
from typing import Any

import numpy as np

import strand
from strand import config
from strand.box import Bounds, extraction_range
from strand.checks import Array
from strand.files import extra, replacing, require_writable
from strand.io.budget import MAX_BYTES
from strand.io.description import parse_length
from strand.io.export import format_of
from strand.io.intrinsics import read_intrinsics
from strand.io.recordings import Frame, Recording, is_recording
from strand.io.recordings.recording import TOLERANCE
from strand.io.scenes import Scene, load_scene
from strand.model import content
from strand.report import figures, page, rerun_view, tables

_OF_RECORDINGS = ("topic", "frame", "every", "world", "tolerance", "ignore_distortion")
_OF_FILES = ("viewpoint", "camera_frame", "intrinsics", "mask")

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
        description="Reconstruct the ropes of a scene.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_scene(reconstruct)
    reconstruct.add_argument(
        "-o",
        "--out",
        type=_path,
        metavar="MODEL",
        help="the file to write: .json, .csv (a row for each node) or .ply (a polyline for each rope); with "
        "--every, one line of JSON for each frame (default: none)",
    )
    reconstruct.add_argument(
        "--tube", type=_path, metavar="MESH", help="also write the ropes' surface to this .ply file"
    )
    _add_known(reconstruct)
    reconstruct.add_argument(
        "--every",
        type=int,
        metavar="N",
        help="of a recording --frame and every Nth after it (default: one frame)",
    )
    reconstruct.add_argument("--figures", type=_path, metavar="DIR", help="draw every stage into this folder")
    reconstruct.set_defaults(run=_reconstruct)

    report = commands.add_parser(
        "report",
        help="a page about a recorded scene, to look at in a browser",
        description="Reconstruct the ropes of a scene, and write one HTML page about them, which needs no "
        "network: points and chains in space, chains over each depth image, doubts, times.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_scene(report)
    report.add_argument(
        "-o", "--out", type=_path, required=True, metavar="PAGE", help="the HTML file to write"
    )
    _add_known(report)
    report.set_defaults(run=_report)

    view = commands.add_parser(
        "view",
        help="a recorded scene and its ropes in the viewer Rerun",
        description="Reconstruct the ropes of a scene, and show them in Rerun: "
        'pip install ".[rerun]" installs it.',
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_scene(view)
    view.add_argument("--save", type=_path, metavar="FILE", help="write this .rrd file, and open no window")
    _add_known(view)
    view.set_defaults(run=_view)
    return parser


def _add_scene(command: argparse.ArgumentParser) -> None:
    """Add what names a scene, and what single files do not say of themselves."""
    command.add_argument(
        "scene",
        type=_path,
        nargs="+",
        metavar="SCENE",
        help="a folder with a scene.toml, an .npz file, a single file of one view: points "
        "(.ply, .pcd, .npy, .xyz, .csv, ...) or a depth image (.png, .tiff, .npy); or a recording: a .bag, "
        ".mcap or .db3 file, or the folder of a ROS 2 bag",
    )
    command.add_argument(
        "--viewpoint",
        type=_place,
        metavar="X,Y,Z",
        help="where the camera was: a single file's points are in the world frame, metres",
    )
    command.add_argument(
        "--camera-frame",
        action="store_true",
        help="a single file's points are in the camera frame: x right, y down, z forward",
    )
    command.add_argument(
        "--intrinsics",
        type=_intrinsics,
        metavar="FX,FY,CX,CY",
        help="the camera of a single depth image, pixels; or a file with its 3 x 3 matrix",
    )
    command.add_argument(
        "--depth-scale",
        type=float,
        metavar="METRES",
        help="what a unit of a single depth image or a recording's is, such as 0.001 (default: floats are "
        "metres, and a recording's whole numbers what it says, else 0.001)",
    )
    _add_recording_options(command.add_argument_group("recordings"))


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
        "--ignore-distortion", action="store_true", help="take images of lenses that distort as they are"
    )


def _add_known(command: argparse.ArgumentParser) -> None:
    """Add what may be known of a scene, and how it is worked on."""
    command.add_argument(
        "--radius",
        type=_length,
        metavar="LENGTH",
        help="the ropes' radius, such as 4.2mm (default: the scene's; estimated if it has none)",
    )
    command.add_argument(
        "--ropes", type=int, metavar="N", help="how many there are (default: as many as the data show)"
    )
    command.add_argument(
        "--length",
        type=_length,
        nargs="+",
        metavar="LENGTH",
        help="how long they are, such as 0.4m: one length for all, or one for each (default: not known)",
    )
    command.add_argument(
        "--bounds",
        type=_length,
        nargs=6,
        metavar=("X0", "Y0", "Z0", "X1", "Y1", "Z1"),
        help="extraction range in the world frame, low and high corner, metres (default: the scene's)",
    )
    command.add_argument(
        "--mask",
        type=_path,
        nargs="+",
        metavar="PATH",
        help="where the ropes are in each depth image: a PNG or NPY file for each view; 0 is no rope, other "
        "numbers are ropes or pieces of them (default: the scene's)",
    )
    command.add_argument("--config", type=_path, metavar="FILE", help="a TOML file with the method's numbers")
    command.add_argument(
        "--max-bytes",
        type=int,
        default=MAX_BYTES,
        metavar="N",
        help=f"how much memory the scene's files may take (default: {MAX_BYTES})",
    )
    command.add_argument(
        "--outside",
        action="store_true",
        help="let the scene.toml name files outside of its folder, which may be any of yours",
    )
    command.add_argument(
        "--deadline",
        type=float,
        metavar="SECONDS",
        help="leave out what an answer can do without after this time (default: never)",
    )
    # lengths such as -4mm are values, not options
    command._negative_number_matcher = re.compile(r"^-\.?\d")


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
    if options.every is not None:
        with _recording(options) as recording:
            _check_outputs(options, recording.files)
            _reconstruct_frames(options, recording.read(options.frame or 0, None, options.every))
        return
    recorded = _load(options)
    _check_outputs(options, _read(options, recorded))
    model = _solve(options, recorded, keep_stages=options.figures is not None)
    if _radius(options, recorded) is None and model.chains:
        print(
            f"radius: {model.chains[0].radius * 1e3:.2f} mm, estimated from what the views show", end="\n\n"
        )
    print(tables.describe_chains(model), end="\n\n")
    print(tables.describe_timings(model), end="\n\n")
    if options.out is not None:
        model.save(options.out)
        print(options.out)
    if options.tube is not None:
        model.save_tube(options.tube)
        print(options.tube)
    if options.figures is not None:
        for path in figures.write_figures(model, options.figures, recorded.truth):
            print(path)


def _check_outputs(options: argparse.Namespace, read: Sequence[Path]) -> None:
    """Refuse what cannot be written, before there is anything to write."""
    outputs = {"--out": options.out, "--tube": options.tube}
    _keep_input(read, outputs, options.figures)
    given = [path for path in outputs.values() if path is not None]
    if len({os.path.realpath(path) for path in given}) < len(given):
        raise ValueError(f"--tube: {options.tube} is what --out writes")
    for path in given:
        require_writable(path)
    if options.out is not None and options.every is None:
        format_of(options.out)
    if options.tube is not None:
        format_of(options.tube, ("ply",))
    if options.every is not None:
        for option in ("tube", "figures"):
            if vars(options)[option] is not None:
                raise ValueError(f"--{option}: of one frame only, and --every asks for several")


def _reconstruct_frames(options: argparse.Namespace, frames: Iterator[Frame]) -> None:
    """Print a line for each frame, and write one with its model, or with why there is none."""
    known = _known(options)
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


def _report(options: argparse.Namespace) -> None:
    extra("plotly.offline")  # that it is missing is said before the work
    recorded = _load(options)
    _keep_input(_read(options, recorded), {"--out": options.out})
    require_writable(options.out)
    model = _solve(options, recorded, keep_stages=True)
    given = _given(options, recorded)
    page.write_report(
        model, recorded.views, options.out, title=recorded.name, given=given, truth=recorded.truth
    )
    print(options.out)


def _view(options: argparse.Namespace) -> None:
    extra("rerun")
    recorded = _load(options)
    if options.save is not None:
        _keep_input(_read(options, recorded), {"--save": options.save})
        require_writable(options.save)
    model = _solve(options, recorded, keep_stages=True)
    if options.save is None:
        rerun_view.show(model, recorded.views, truth=recorded.truth)
        return
    rerun_view.write_recording(model, recorded.views, options.save, truth=recorded.truth)
    print(options.save)


def _load(options: argparse.Namespace) -> Scene:
    """Read a scene, or one frame of a recording."""
    path = _only(options.scene)
    if is_recording(path):
        with _recording(options) as recording:
            number = options.frame or 0
            frame = next(recording.read(number, number + 1), None)
            if frame is None:
                raise ValueError(
                    f"--frame: expected less than the recording's {len(recording)}, got {number}"
                )
            return Scene(path.name, frame.views, None, None, files=recording.files)
    _refuse(options, _OF_RECORDINGS, f"for recordings only, and {path} is none")
    return load_scene(
        path,
        options.mask,
        viewpoint=options.viewpoint,
        camera_frame=options.camera_frame,
        intrinsics=_matrix_of(options.intrinsics),
        depth_scale=options.depth_scale,
        max_bytes=options.max_bytes,
        outside=options.outside,
    )


def _recording(options: argparse.Namespace) -> Recording:
    """Open a recording."""
    path = _only(options.scene)
    if not is_recording(path):
        _refuse(options, _OF_RECORDINGS, f"for recordings only, and {path} is none")
    _refuse(options, _OF_FILES, "for scenes only; a recording has its own")
    return Recording(
        path,
        options.topic,
        world=options.world,
        tolerance=TOLERANCE if options.tolerance is None else options.tolerance,
        depth_scale=options.depth_scale,
        ignore_distortion=options.ignore_distortion,
        max_bytes=options.max_bytes,
    )


def _only(scenes: Sequence[Path]) -> Path:
    if len(scenes) > 1:
        raise ValueError(
            f"SCENE: expected one, got {len(scenes)}; files of several views need a pose each, which "
            "the scene.toml of a folder says"
        )
    return scenes[0]


def _refuse(options: argparse.Namespace, names: Sequence[str], why: str) -> None:
    """Refuse options that are not for what was given."""
    for name in names:
        if (given := vars(options).get(name)) is not None and given is not False:
            raise ValueError(f"--{name.replace('_', '-')}: {why}")


def _read(options: argparse.Namespace, recorded: Scene) -> tuple[Path, ...]:
    given = (options.config, options.intrinsics if isinstance(options.intrinsics, Path) else None)
    return (*recorded.files, *(path for path in given if path is not None))


def _radius(options: argparse.Namespace, recorded: Scene) -> float | None:
    return recorded.radius if options.radius is None else options.radius


def _bounds(options: argparse.Namespace, recorded: Scene | None) -> Bounds | None:
    if options.bounds is None:
        return None if recorded is None else recorded.bounds
    return np.array(options.bounds[:3]), np.array(options.bounds[3:])


def _known(options: argparse.Namespace, recorded: Scene | None = None) -> dict[str, Any]:
    """Arguments of a reconstruction: what the command line says, or else the scene."""
    return {
        "radius": options.radius if recorded is None else _radius(options, recorded),
        "bounds": _bounds(options, recorded),
        "ropes": options.ropes,
        "length": options.length[0] if options.length and len(options.length) == 1 else options.length,
        "config": strand.Config() if options.config is None else config.load(options.config),
        "deadline": options.deadline,
    }


def _solve(options: argparse.Namespace, recorded: Scene, keep_stages: bool) -> strand.Model:
    """Reconstruct a scene's ropes; say what is at work, and what is to be warned of."""
    known = _known(options, recorded)
    stages = set(tables.STAGE_ARRAYS[known["config"].method])
    if known["radius"] is not None:
        stages.discard("radius")
    with _progress(len(stages)) as progress:
        model = strand.reconstruct(recorded.views, **known, keep_stages=keep_stages, progress=progress)
    _warn(model)
    return model


def _given(options: argparse.Namespace, recorded: Scene) -> dict[str, str]:
    """Say what was known beforehand."""
    radius, bounds = _radius(options, recorded), _bounds(options, recorded)
    given = {
        "scene": f"{options.scene[0]}",
        "radius": "not given: estimated" if radius is None else f"{radius * 1e3:.2f} mm",
        "ropes": "not given" if options.ropes is None else f"{options.ropes}",
        "lengths": ", ".join(f"{length * 1e3:.0f} mm" for length in options.length or ()) or "not given",
        "extraction range": "not given",
        "configuration": "defaults" if options.config is None else f"{options.config}",
    }
    if bounds is not None:
        given["extraction range"] = f"{extraction_range(bounds)}"
    return given


def _keep_input(read: Sequence[Path], outputs: Mapping[str, Path | None], drawn: Path | None = None) -> None:
    """Refuse to write what options name, or a figure, over a file that was read.

    Raises
    ------
    ValueError
        If it would.
    """
    kept = {os.path.realpath(path) for path in read}
    written = {option: [path] for option, path in outputs.items() if path is not None}
    if drawn is not None and drawn.is_dir():
        written["--figures"] = list(drawn.glob("[0-9]*-*.png"))
    for named, paths in written.items():
        for path in paths:
            if os.path.realpath(path) in kept:
                raise ValueError(f"{named}: {path} is part of the scene or the configuration")


def _path(text: str) -> Path:
    if not text:
        raise argparse.ArgumentTypeError("expected a path, got an empty text")
    return Path(text)


def _length(text: str) -> float:
    try:
        return parse_length(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _place(text: str) -> tuple[float, ...]:
    words = text.split(",")
    if len(words) != 3:
        raise argparse.ArgumentTypeError(f"expected x,y,z, got {text!r}")
    return tuple(_length(word) for word in words)


def _intrinsics(text: str) -> tuple[float, ...] | Path:
    """Four numbers, or the file that holds a matrix."""
    words = text.split(",")
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        return _path(text)
    if len(numbers) != 4:
        raise argparse.ArgumentTypeError(f"expected fx,fy,cx,cy or a file, got {text!r}")
    return numbers


def _matrix_of(given: tuple[float, ...] | Path | None) -> Array | None:
    """(3, 3) The pinhole matrix of four numbers, or of a file."""
    if given is None or isinstance(given, Path):
        return None if given is None else read_intrinsics(given)
    fx, fy, cx, cy = given
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


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
