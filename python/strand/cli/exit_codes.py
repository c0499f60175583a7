"""The exit code of a command, and the line on stderr that explains it."""

from __future__ import annotations

import os
import sys

from strand._core import StrandError
from strand.cli.terminal import print_message

EXIT_CODES = """\
exit codes:
  0    success
  1    the data do not support an answer; a file is damaged, of another kind,
       or too large
  2    wrong arguments, or values that are not accepted
  3    a file is missing, or cannot be read or written; an optional package is
       not installed; or the processes of a batch cannot work
  130  interrupted
  141  the reader of the output has closed it
"""


def report_error(error: BaseException) -> int:
    """Print an error as one line, and return the exit code; raise an error that nobody expects again."""
    from strand.batch import (
        EngineError,
    )  # imports most of strand, which a command without an error may not need

    match error:
        case BrokenPipeError():
            return 141
        case KeyboardInterrupt():
            return _print_error("interrupted", 130)
        case MemoryError():
            return _print_error("out of memory", 1)
        case EngineError():
            return _print_error(error, 3)
        case StrandError():
            return _print_error(error, 1)
        case ValueError() | TypeError():
            return _print_error(error, 2)
        case OSError():
            return _print_error(f"{error.filename}: {error.strerror}" if error.filename else error, 3)
        case ImportError():
            return _print_error(error, 3)
    raise error


def flush_output(code: int) -> int:
    """Flush stdout, and return the exit code; if that fails and `code` is 0, return the error's code."""
    try:
        sys.stdout.flush()
    except OSError as error:
        # Python flushes the buffer once more at its exit, which must not fail again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return code or report_error(error)
    return code


def _print_error(error: object, code: int) -> int:
    print_message(f"strand: error: {' '.join(str(error).split())}")
    return code
