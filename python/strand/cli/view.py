"""`strand view`: a scene and its ropes in the Rerun viewer."""

from __future__ import annotations

import argparse

from strand.cli import values
from strand.cli.arguments import reconstruct_scene
from strand.cli.inputs import list_input_files, load_input
from strand.cli.model_output import print_remarks
from strand.cli.options import add_priors, add_scene
from strand.cli.outputs import protect_inputs
from strand.report import rerun_view
from strand.support.extras import import_extra
from strand.support.files import require_writable

DESCRIPTION = """\
Reconstruct the ropes of a scene, and show them in the viewer Rerun, which the
extra "rerun" installs."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's arguments."""
    add_scene(command)
    command.add_argument(
        "--save",
        type=values.parse_path,
        metavar="FILE",
        help="write this .rrd file, and open no window",
    )
    add_priors(command)


def run(options: argparse.Namespace) -> None:
    """Reconstruct a scene's ropes, and show them in a window or save the recording."""
    import_extra("rerun")  # report a missing package before the work
    scene = load_input(options)
    if options.save is not None:
        protect_inputs(list_input_files(options, scene), {"--save": options.save})
        require_writable(options.save)
    model = reconstruct_scene(options, scene, keep_stages=True)
    print_remarks(model)
    if options.save is None:
        rerun_view.show(model, scene.views, truth=scene.truth)
        return
    rerun_view.write_recording(model, scene.views, options.save, truth=scene.truth)
    print(options.save)
