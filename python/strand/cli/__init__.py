"""The command line: `strand reconstruct` and the other commands. It handles arguments and text only."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from strand.cli.exit_codes import flush_output, report_error
from strand.cli.parser import make_parser
from strand.cli.terminal import open_closed_streams


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        The words after the program's name; by default those of this process.

    Returns
    -------
    int
        The exit code, one of `strand.cli.exit_codes.EXIT_CODES`.

    Raises
    ------
    SystemExit
        By argparse: with 2 for wrong usage, with 0 after `--help` and `--version`.
    """
    open_closed_streams()
    try:
        words = sys.argv[1:] if arguments is None else list(arguments)
        options = make_parser(words).parse_args(words)
        code = options.run(options) or 0
    except SystemExit as error:  # argparse has printed the help, but maybe not flushed it
        code = flush_output(error.code if isinstance(error.code, int) else 2)
        raise SystemExit(code) from None
    except BaseException as error:
        code = report_error(error)
    return flush_output(code)
