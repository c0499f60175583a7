"""The commands that there are."""

from __future__ import annotations

import argparse

import strand
from strand.cli import batch, demo, info, reconstruct, report, view
from strand.cli.outcome import EXIT_CODES

_COMMANDS = {
    "batch": batch,
    "demo": demo,
    "info": info,
    "reconstruct": reconstruct,
    "report": report,
    "view": view,
}


def parser() -> argparse.ArgumentParser:
    """Return the parser; the options that it gives have the command to `run`."""
    whole = argparse.ArgumentParser(
        prog="strand",
        description="Ordered 3D centrelines of strings, ropes, cables and hoses from depth\ncameras' data.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    whole.add_argument("--version", action="version", version=f"strand {strand.__version__}")
    commands = whole.add_subparsers(required=True, metavar="COMMAND")
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
    return whole
