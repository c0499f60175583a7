"""`strand reconstruct`: the ropes of a scene, of a frame, or of many frames."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import strand
from strand.cli import values
from strand.cli.answers import print_json, warn
from strand.cli.inputs import files_read, load, open_recording
from strand.cli.options import add_known, add_scene
from strand.cli.outputs import check_outputs
from strand.cli.progress import progress
from strand.cli.solving import known, radius_of, solve
from strand.io.recordings import Frame
from strand.io.scenes import Scene
from strand.report import figures, tables
from strand.ropes.model import describe_model
from strand.support.files import replace_file

HINT = "ropes of a recorded scene"
DESCRIPTION = """\
Reconstruct the ropes of a scene, and print them with what speaks against them.
`strand info SCENE` says which options it needs."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's words."""
    add_scene(command)
    command.add_argument(
        "-o",
        "--out",
        type=values.path,
        metavar="MODEL",
        help="the file to write: .json, .csv (a row for each node) or .ply (a polyline for each rope); with "
        "--every, one line of JSON for each frame (default: none)",
    )
    command.add_argument(
        "--tube", type=values.path, metavar="MESH", help="also write the ropes' surface to this .ply file"
    )
    add_known(command)
    command.add_argument(
        "--every",
        type=int,
        metavar="N",
        help="of a recording --frame and every Nth after it (default: one frame)",
    )
    command.add_argument(
        "--json",
        action="store_true",
        help="print the model as its .json file has it, and nothing else; with --every a line for each frame",
    )
    command.add_argument(
        "--figures", type=values.path, metavar="DIR", help="draw every stage into this folder"
    )


def run(options: argparse.Namespace) -> None:
    """Reconstruct a scene's ropes, print them, and write what is asked for."""
    if options.every is not None:
        with open_recording(options) as recording:
            check_outputs(options, recording.files)
            _each_frame(options, recording.read(options.frame or 0, None, options.every))
        return
    recorded = load(options)
    check_outputs(options, files_read(options, recorded))
    model = solve(options, recorded, keep_stages=options.figures is not None)
    if options.json:
        print_json(model)
        warn(model, doubts=True)
    else:
        _print_tables(model, estimated=radius_of(options, recorded) is None)
    for path in _written(options, model, recorded):
        if not options.json:
            print(path)


def _print_tables(model: strand.Model, estimated: bool) -> None:
    """Print the chains, what speaks against them, and the stages' times."""
    if estimated and model.chains:
        print(
            f"radius: {model.chains[0].radius * 1e3:.2f} mm, estimated from what the views show", end="\n\n"
        )
    print(tables.describe_chains(model), end="\n\n")
    if crossings := tables.describe_crossings(model):
        print(crossings, end="\n\n")
    print(tables.describe_confidence(model))
    warn(model, doubts=True)
    print(f"\n{tables.describe_timings(model)}", end="\n\n")


def _written(options: argparse.Namespace, model: strand.Model, recorded: Scene) -> Iterator[Path]:
    """Write what is asked for, and give each path when it is written."""
    if options.out is not None:
        model.save(options.out)
        yield options.out
    if options.tube is not None:
        model.save_tube(options.tube)
        yield options.tube
    if options.figures is not None:
        with progress("figures"):
            drawn = figures.write_figures(model, options.figures, recorded.truth)
        yield from drawn


def _each_frame(options: argparse.Namespace, frames: Iterator[Frame]) -> None:
    """Print a line for each frame, and write one with its model, or with why there is none."""
    given = known(options)
    previous, count = None, 0
    with nullcontext() if options.out is None else replace_file(options.out) as file:
        for frame in frames:
            count += 1
            said: dict[str, object] = {"frame": frame.number, "stamp": frame.stamp}
            model = None
            try:
                with progress(f"frame {frame.number}"):
                    model = strand.reconstruct(frame.views, **given, previous=previous)
            except strand.NotEnoughDataError as error:
                said["error"] = shown = str(error)
            else:
                said["model"] = describe_model(model)
                shown = tables.describe_frame(model)
            line = json.dumps(said, allow_nan=False)
            words = f"frame {frame.number} at {frame.time:.3f} s: {shown}"
            print(line if options.json else words, flush=True)
            if model is not None:
                previous = model
                warn(model, f"frame {frame.number}: ")
            if file is not None:
                file.write(line.encode() + b"\n")
        if previous is None:
            raise strand.NotEnoughDataError(f"none of {count} frames supports an answer")
    if options.out is not None and not options.json:
        print(options.out)
