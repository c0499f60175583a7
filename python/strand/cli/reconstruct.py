"""`strand reconstruct`: the ropes of a scene, of a frame, or of many frames."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import strand
from strand.cli import values
from strand.cli.arguments import choose_radius, collect_arguments, reconstruct_scene
from strand.cli.inputs import (
    choose_frames,
    describe_missing_frame,
    find_frame_id,
    list_input_files,
    load_input,
    open_recording,
)
from strand.cli.model_output import print_json, print_remarks
from strand.cli.options import add_priors, add_scene
from strand.cli.outputs import check_outputs
from strand.cli.progress import show_progress
from strand.cli.report import write_page
from strand.io.recordings import Recording
from strand.io.scenes import Scene
from strand.report import figures, tables
from strand.report.frame_table import format_frame, format_head
from strand.report.scene_updates import write_mcap
from strand.ropes.model import describe_model
from strand.support.checks import check_integer
from strand.support.extras import import_extra
from strand.support.files import replace_file

DESCRIPTION = """\
Reconstruct the ropes of a scene, and print them with warnings and doubts.
`strand info SCENE` shows which options it needs."""


class _Answer(NamedTuple):
    """A frame's number and time, its line of JSON, and why it has no model."""

    number: int
    stamp: int
    line: str
    error: str


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scene(command)
    command.add_argument(
        "-o",
        "--out",
        type=values.parse_path,
        metavar="MODEL",
        help="write the model: .json, .csv (one row per node), .ply (one polyline per rope) or .usda "
        "(deformable curves), or .mcap for the viewer Foxglove; with --branches also .graphml; with --every, "
        ".mcap has all frames, .csv one row per rope and frame, .json or .jsonl one line of JSON per frame",
    )
    command.add_argument(
        "--tube",
        type=values.parse_path,
        metavar="MESH",
        help="also write the ropes' surface to this .ply file",
    )
    add_priors(command)
    command.add_argument(
        "--every",
        type=int,
        metavar="N",
        help="reconstruct a recording's --frame and every Nth after it (default: one frame)",
    )
    command.add_argument(
        "--json",
        action="store_true",
        help="print only the model, as its .json file holds it; with --every, one line per frame",
    )
    command.add_argument(
        "--report", type=values.parse_path, metavar="PAGE", help="write an HTML page, as `strand report` does"
    )
    command.add_argument(
        "--figures", type=values.parse_path, metavar="DIR", help="draw every stage into this folder"
    )


def run(options: argparse.Namespace) -> None:
    """Reconstruct a scene's ropes, print them, and write the requested files."""
    if options.every is not None:
        check_integer("--every", options.every, 1)
        with open_recording(options) as recording:
            check_outputs(options, recording.files)
            _reconstruct_frames(options, recording)
        return
    scene = load_input(options)
    check_outputs(options, list_input_files(options, scene))
    if options.report is not None:
        import_extra("plotly.offline")  # report a missing package before the work
    drawn = options.figures is not None or options.report is not None
    model = reconstruct_scene(options, scene, keep_stages=drawn)
    if options.json:
        print_json(model)
        print_remarks(model, doubts=True)
    else:
        _print_tables(model, estimated=choose_radius(options, scene) is None)
    for path in _write_outputs(options, model, scene):
        if not options.json:
            print(path)


def _print_tables(model: strand.Model, estimated: bool) -> None:
    """Print the chains, crossings, confidence, remarks and times."""
    if estimated and model.chains:
        radius, sd = 1e3 * model.chains[0].radius, 1e3 * model.chains[0].radius_sd
        print(f"radius: {radius:.2f} ± {sd:.2f} mm, estimated from the views", end="\n\n")
    print(tables.describe_chains(model), end="\n\n")
    if crossings := tables.describe_crossings(model):
        print(crossings, end="\n\n")
    print(tables.describe_confidence(model))
    print_remarks(model, doubts=True)
    print(f"\n{tables.describe_timings(model)}", end="\n\n")


def _write_outputs(options: argparse.Namespace, model: strand.Model, scene: Scene) -> Iterator[Path]:
    """Write the requested files, and yield the path of each."""
    if options.out is not None:
        if _has_suffix(options.out, "mcap"):
            write_mcap([model], options.out, frame_id=find_frame_id(options))
        elif _has_suffix(options.out, "graphml") and model.harness is not None:
            model.harness.save(options.out)
        else:
            model.save(options.out)
        yield options.out
    if options.tube is not None:
        model.save_tube(options.tube)
        yield options.tube
    if options.report is not None:
        write_page(options, scene, model, options.report)
        yield options.report
    if options.figures is not None:
        with show_progress("figures"):
            drawn = figures.write_figures(model, options.figures, scene.truth)
        yield from drawn


def _has_suffix(path: Path | None, suffix: str) -> bool:
    return path is not None and path.suffix.lower() == f".{suffix}"


def _reconstruct_frames(options: argparse.Namespace, recording: Recording) -> None:
    """Print a line for each frame, and write its model or the reason why it has none."""
    frames = _answer_frames(options, recording)
    if options.out is not None and _has_suffix(options.out, "mcap"):
        models = (model for _, model in frames if model is not None)
        write_mcap(models, options.out, frame_id=recording.frame_id)
    else:
        table = _has_suffix(options.out, "csv")
        with nullcontext() if options.out is None else replace_file(options.out) as file:
            if file is not None and table:
                file.write(format_head())
            for answer, model in frames:
                if file is not None:
                    row = format_frame(answer.number, answer.stamp, model, answer.error)
                    file.write(row if table else answer.line.encode() + b"\n")
    if options.out is not None and not options.json:
        print(options.out)


def _answer_frames(
    options: argparse.Namespace, recording: Recording
) -> Iterator[tuple[_Answer, strand.Model | None]]:
    """Print a line for each frame; yield its answer, and its model if it supports one."""
    arguments = collect_arguments(options)
    previous, answered, count = None, False, 0
    first, stop = choose_frames(options, recording)
    episode = range(0)
    for frame in recording.read(first, stop, options.every):
        count += 1
        if frame.number not in episode:
            # the ropes of another episode have an order of their own
            previous = None
            episode = next((one for one in recording.episodes if frame.number in one), range(sys.maxsize))
        record: dict[str, object] = {"frame": frame.number, "stamp": frame.stamp}
        model = None
        try:
            with show_progress(f"frame {frame.number}"):
                model = strand.reconstruct(frame.views, **arguments, previous=previous)
        except strand.NotEnoughDataError as error:
            record["error"] = summary = str(error)
        else:
            record["model"] = describe_model(model)
            summary = tables.describe_frame(model)
        line = json.dumps(record, allow_nan=False)
        words = f"frame {frame.number} at {frame.time:.3f} s: {summary}"
        print(line if options.json else words, flush=True)
        if model is not None:
            previous, answered = model, True
            print_remarks(model, f"frame {frame.number}: ")
        yield _Answer(frame.number, frame.stamp, line, "" if model is not None else summary), model
    if not count:
        raise ValueError(describe_missing_frame(first, len(recording)))
    if not answered:
        raise strand.NotEnoughDataError(f"none of {count} frames supports an answer; the last one: {summary}")
