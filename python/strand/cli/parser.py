"""The argument parser, with one subcommand per module."""

from __future__ import annotations

import argparse

import strand
from strand.cli import batch, demo, info, mask, reconstruct, report, track, view
from strand.cli.exit_codes import EXIT_CODES

_COMMANDS = {
    "batch": batch,
    "demo": demo,
    "info": info,
    "mask": mask,
    "reconstruct": reconstruct,
    "report": report,
    "track": track,
    "view": view,
}


def make_parser() -> argparse.ArgumentParser:
    """Return the parser; the options that it returns have the command's function as `run`."""
    parser = argparse.ArgumentParser(
        prog="strand",
        description="Ordered 3D centrelines of strings, ropes, cables and hoses from depth cameras.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"strand {strand.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for name, module in _COMMANDS.items():
        command = commands.add_parser(
            name,
            help=module.HINT,
            description=module.DESCRIPTION,
            epilog=EXIT_CODES,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser
