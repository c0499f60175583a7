"""`strand info`: the contents of files, and what `strand reconstruct` would do with them."""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from strand.cli import values
from strand.cli.advice import Advice, advise
from strand.cli.contents_text import describe_contents, name_format, name_kind
from strand.cli.exit_codes import report_error
from strand.cli.options import add_limits
from strand.cli.progress import show_progress
from strand.cli.terminal import flush_before_message
from strand.io.file_contents import Contents, SceneContents, SingleContents, read_contents
from strand.io.recordings.recording_contents import RecordingContents
from strand.support.files import convert_to_json

if TYPE_CHECKING:
    from strand.ropes.model import Model

DESCRIPTION = """\
Show what scenes, recordings, point clouds, depth images and models hold, what
is missing, and what `strand reconstruct` would do with them. A file that
cannot be read is an error on stderr; strand still describes the others."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    command.add_argument(
        "files",
        type=values.parse_path,
        nargs="+",
        metavar="FILE",
        help="a SCENE of `strand reconstruct`, or a model's .json file",
    )
    command.add_argument(
        "--topic",
        nargs="+",
        metavar="TOPIC",
        help="topics of a recording to look at; * stands for any text (default: all with depth)",
    )
    command.add_argument("--json", action="store_true", help="print one line of JSON for each file")
    add_limits(command)


def run(options: argparse.Namespace) -> int:
    """Describe each file; return the exit code of the first that cannot be read, or 0."""
    codes, separator = [], ""
    for path in options.files:
        try:
            with show_progress("read"):
                contents = read_contents(
                    path, options.topic, max_bytes=options.max_bytes, outside=options.outside
                )
        except Exception as error:
            flush_before_message()
            codes.append(report_error(error))
            continue
        advice = advise(path, contents, topics_given=options.topic is not None)
        if options.json:
            print(json.dumps(_convert_contents(path, contents, advice), allow_nan=False))
        else:
            print(separator + describe_contents(path, contents, advice))
            separator = "\n"
    return next(iter(codes), 0)


def _convert_contents(path: Path, contents: Contents, advice: Advice) -> dict[str, object]:
    """Return a file's contents and the advice in JSON's types."""
    match contents:
        case RecordingContents() | SceneContents() | SingleContents():
            holds = _replace_infinite(convert_to_json(contents))
        case _:
            holds = _convert_model(contents)
    return {
        "file": str(path),
        "kind": name_kind(contents),
        "format": name_format(path, contents),
        "holds": holds,
        "missing": list(advice.missing),
        "reconstruct": {"command": advice.command, "plan": advice.plan},
    }


def _replace_infinite(value: Any) -> Any:
    """Return a value in JSON's types with null for infinite numbers, which the sides of bounds may be."""
    if isinstance(value, dict):
        return {key: _replace_infinite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_replace_infinite(entry) for entry in value]
    return None if isinstance(value, float) and math.isinf(value) else value


def _convert_model(model: Model) -> dict[str, object]:
    """Return a summary of a model in JSON's types, without nodes and matrices."""
    chains = [
        {
            "length": chain.length,
            "radius": chain.radius,
            "nodes": len(chain.points),
            "closed": chain.closed,
            "hidden_ends": list(chain.hidden_ends),
            "label": chain.label,
            "color": convert_to_json(chain.color),
            "confidence": convert_to_json(chain.confidence),
            "doubts": [doubt.kind for doubt in chain.doubts],
        }
        for chain in model.chains
    ]
    return {
        "method": model.method,
        "views": len(model.poses),
        "confidence": convert_to_json(model.confidence),
        "doubts": [doubt.kind for doubt in model.doubts],
        "warnings": [warning.kind for warning in model.warnings],
        "stamp": model.stamp,
        "up": model.up.tolist(),
        "table": None if model.table is None else convert_to_json(model.table._asdict()),
        "chains": chains,
    }
