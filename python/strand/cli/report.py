"""`strand report`: a page about a scene."""

from __future__ import annotations

import argparse
from pathlib import Path

from strand.cli import values
from strand.cli.arguments import describe_arguments, reconstruct_scene
from strand.cli.inputs import list_input_files, load_input
from strand.cli.model_output import print_remarks
from strand.cli.options import add_priors, add_scene
from strand.cli.outputs import protect_inputs
from strand.cli.progress import show_progress
from strand.io.scenes import Scene
from strand.report import page
from strand.ropes.model import Model
from strand.support.extras import import_extra
from strand.support.files import require_writable

DESCRIPTION = """\
Reconstruct the ropes of a scene, and write one HTML page about them: points
and chains in 3D, chains over each depth image, doubts, times. The page needs
no network."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scene(command)
    command.add_argument(
        "-o", "--out", type=values.parse_path, required=True, metavar="PAGE", help="the HTML file to write"
    )
    add_priors(command)


def run(options: argparse.Namespace) -> None:
    """Reconstruct a scene's ropes, and write a page about them."""
    import_extra("plotly.offline")  # report a missing package before the work
    scene = load_input(options)
    protect_inputs(list_input_files(options, scene), {"--out": options.out})
    require_writable(options.out)
    model = reconstruct_scene(options, scene, keep_stages=True)
    print_remarks(model)
    write_page(options, scene, model, options.out)
    print(options.out)


def write_page(options: argparse.Namespace, scene: Scene, model: Model, path: Path) -> None:
    """Write the page about a scene, with the values that the user or the scene gave."""
    given = describe_arguments(options, scene)
    with show_progress("page"):
        page.write_report(model, scene.views, path, title=scene.name, given=given, truth=scene.truth)
