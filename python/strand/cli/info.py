"""`strand info`: what files hold, and what `strand reconstruct` would do with them."""

from __future__ import annotations

import argparse
import json
import math
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from strand.cli import values
from strand.cli.advice import Advice, advice
from strand.cli.described import described, format_of, kind_of
from strand.cli.options import add_limits
from strand.cli.outcome import code_of
from strand.cli.progress import progress
from strand.io.file_contents import Contents, read_contents
from strand.ropes.model import Model
from strand.support.files import convert_to_json

HINT = "what a file holds, and what would be done with it"
DESCRIPTION = """\
Say what scenes, recordings, point clouds, depth images and models hold, what
is missing, and what `strand reconstruct` would do with them. A file that
cannot be read is said on stderr, and the others are described all the same."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's words."""
    command.add_argument(
        "files",
        type=values.path,
        nargs="+",
        metavar="FILE",
        help="what `strand reconstruct` takes, or a model's .json file",
    )
    command.add_argument(
        "--topic",
        nargs="+",
        metavar="TOPIC",
        help="of a recording: topics with depth to look at; * stands for any text (default: all)",
    )
    command.add_argument("--json", action="store_true", help="print one line of JSON for each file")
    add_limits(command)


def run(options: argparse.Namespace) -> int:
    """Describe each file, and return the exit code of the first one that cannot be read; 0 if all can."""
    codes, blank = [], ""
    for path in options.files:
        try:
            with progress("read"):
                held = read_contents(
                    path, options.topic, max_bytes=options.max_bytes, outside=options.outside
                )
        except Exception as error:
            # what was printed before stands before it
            with suppress(OSError):
                sys.stdout.flush()
            codes.append(code_of(error))
            continue
        would = advice(path, held, asked=options.topic is not None)
        if options.json:
            print(json.dumps(_as_json(path, held, would), allow_nan=False))
        else:
            print(blank + described(path, held, would))
            blank = "\n"
    return next(iter(codes), 0)


def _as_json(path: Path, held: Contents, would: Advice) -> dict[str, object]:
    """Return what a file holds in JSON's types."""
    return {
        "file": str(path),
        "kind": kind_of(held),
        "format": format_of(path, held),
        "holds": _model(held) if isinstance(held, Model) else _finite(convert_to_json(held)),
        "missing": list(would.missing),
        "reconstruct": {"command": would.command, "would": would.would},
    }


def _finite(value: Any) -> Any:
    """Return a value in JSON's types with null for what is infinite, as sides of bounds may be."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and math.isinf(value) else value


def _model(held: Model) -> dict[str, object]:
    """Return what a model holds, without nodes and matrices: its file has these."""
    chains = [
        {
            "length": chain.length,
            "radius": chain.radius,
            "nodes": len(chain.points),
            "closed": chain.closed,
            "confidence": convert_to_json(chain.confidence),
            "doubts": [doubt.kind for doubt in chain.doubts],
        }
        for chain in held.chains
    ]
    return {
        "method": held.method,
        "views": len(held.poses),
        "confidence": convert_to_json(held.confidence),
        "doubts": [doubt.kind for doubt in held.doubts],
        "warnings": [warning.kind for warning in held.warnings],
        "chains": chains,
    }
