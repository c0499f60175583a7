"""The argument parser, with one subcommand per module."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Sequence

from strand import __version__
from strand.cli.exit_codes import EXIT_CODES

_HINTS = {  # of each command; its module has the same name
    "batch": "write a table of the ropes of many recordings",
    "demo": "reconstruct a simulated rope with both methods",
    "info": "show what files hold, and how to reconstruct them",
    "mask": "find the pixels of ropes in a colour image",
    "reconstruct": "reconstruct the ropes of a recorded scene",
    "report": "write an HTML page about a recorded scene",
    "track": "follow ropes through the frames of a recording",
    "view": "show a recorded scene and its ropes in Rerun",
}


def make_parser(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of a command line; the options that it returns have the command's function as `run`.

    Only the command among `words` gets its arguments: importing the modules of all takes longer than
    `strand info` needs.
    """
    parser = argparse.ArgumentParser(
        prog="strand",
        description="Ordered 3D centrelines of strings, ropes, cables and hoses from depth cameras.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"strand {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, hint in _HINTS.items():
        command = commands.add_parser(
            name, help=hint, epilog=EXIT_CODES, formatter_class=argparse.RawDescriptionHelpFormatter
        )
        if name in words:
            module = importlib.import_module(f"strand.cli.{name}")
            command.description = module.DESCRIPTION
            module.add_arguments(command)
            command.set_defaults(run=module.run)
    return parser
