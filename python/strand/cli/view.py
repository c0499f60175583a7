"""`strand view`: a scene and its ropes in the viewer Rerun."""

from __future__ import annotations

import argparse

from strand.cli import values
from strand.cli.answers import warn
from strand.cli.inputs import files_read, load
from strand.cli.options import add_known, add_scene
from strand.cli.outputs import keep_input
from strand.cli.solving import solve
from strand.report import rerun_view
from strand.support.extras import import_extra
from strand.support.files import require_writable

HINT = "a recorded scene and its ropes in the viewer Rerun"
DESCRIPTION = """\
Reconstruct the ropes of a scene, and show them in Rerun, which the extra
"rerun" installs."""


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the command's words."""
    add_scene(command)
    command.add_argument(
        "--save", type=values.path, metavar="FILE", help="write this .rrd file, and open no window"
    )
    add_known(command)


def run(options: argparse.Namespace) -> None:
    """Reconstruct a scene's ropes, and show them in a window, or save what it would show."""
    import_extra("rerun")  # that it is missing is said before the work
    recorded = load(options)
    if options.save is not None:
        keep_input(files_read(options, recorded), {"--save": options.save})
        require_writable(options.save)
    model = solve(options, recorded, keep_stages=True)
    warn(model)
    if options.save is None:
        rerun_view.show(model, recorded.views, truth=recorded.truth)
        return
    rerun_view.write_recording(model, recorded.views, options.save, truth=recorded.truth)
    print(options.save)
