"""The command line: `strand reconstruct` and the other commands. Arguments and lines of text only."""

from __future__ import annotations

from collections.abc import Sequence

from strand.cli.outcome import code_of, flushed, open_closed_streams
from strand.cli.parser import parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name; those of this process if not given.

    Returns
    -------
    int
        The exit code, see `strand.cli.outcome.EXIT_CODES`.

    Raises
    ------
    SystemExit
        From argparse: with 2 for wrong usage, with 0 after `--help` and `--version`.
    """
    open_closed_streams()
    try:
        options = parser().parse_args(arguments)
        code = options.run(options) or 0
    except SystemExit as error:  # help is printed, which may fail as all that is printed
        code = flushed(error.code if isinstance(error.code, int) else 2)
        raise SystemExit(code) from None
    except BaseException as error:
        code = code_of(error)
    return flushed(code)
