"""`strand report`: a page about a scene."""

from __future__ import annotations

import argparse

from strand.cli import values
from strand.cli.answers import warn
from strand.cli.inputs import files_read, load
from strand.cli.options import add_known, add_scene
from strand.cli.outputs import keep_input
from strand.cli.progress import progress
from strand.cli.solving import in_words, solve
from strand.report import page
from strand.support.extras import import_extra
from strand.support.files import require_writable

HINT = "a page about a recorded scene, to look at in a browser"
DESCRIPTION = """\
Reconstruct the ropes of a scene, and write one HTML page about them, which
needs no network: points and chains in space, chains over each depth image,
doubts, times."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's words."""
    add_scene(command)
    command.add_argument(
        "-o", "--out", type=values.path, required=True, metavar="PAGE", help="the HTML file to write"
    )
    add_known(command)


def run(options: argparse.Namespace) -> None:
    """Reconstruct a scene's ropes, and write a page about them."""
    import_extra("plotly.offline")  # that it is missing is said before the work
    recorded = load(options)
    keep_input(files_read(options, recorded), {"--out": options.out})
    require_writable(options.out)
    model = solve(options, recorded, keep_stages=True)
    warn(model)
    given = in_words(options, recorded)
    with progress("page"):
        page.write_report(
            model, recorded.views, options.out, title=recorded.name, given=given, truth=recorded.truth
        )
    print(options.out)
