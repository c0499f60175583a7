"""How a command ends: its exit code, and the line that says what was wrong."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from contextlib import suppress
from io import TextIOWrapper

import strand
from strand.batch import EngineError

# columns that words get on a terminal, however narrow it is
_LEAST = 30

EXIT_CODES = """\
exit codes:
  0    done
  1    the data do not support an answer; a file is damaged, not what it should
       be, or too large
  2    wrong arguments, or values that are not accepted
  3    a file is missing, or cannot be read or written; an optional package is
       not installed; or the processes of a batch cannot work
  130  interrupted
  141  nobody reads the output any more
"""


def code_of(error: BaseException) -> int:
    """Say what was wrong, and return the exit code; what no one expects is raised again."""
    match error:
        case BrokenPipeError():
            return 141
        case KeyboardInterrupt():
            return _fail("interrupted", 130)
        case MemoryError():
            return _fail("out of memory", 1)
        case EngineError():
            return _fail(error, 3)
        case strand.StrandError():
            return _fail(error, 1)
        case ValueError() | TypeError():
            return _fail(error, 2)
        case OSError():
            return _fail(f"{error.filename}: {error.strerror}" if error.filename else error, 3)
        case ImportError():
            return _fail(error, 3)
    raise error


def flushed(code: int) -> int:
    """Print what is left to print, and return the exit code: of an error of that if there was none."""
    try:
        sys.stdout.flush()
    except OSError as error:
        # what is left in the buffer would fail once more when Python exits
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return code or code_of(error)
    return code


def open_closed_streams() -> None:
    """Make standard streams that the caller closed lead nowhere, and stdout print any file's name."""
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def say(line: str) -> None:
    """Print a line to stderr, on a terminal between words; that it may be full is no reason to stop."""
    line = printable(line)
    with suppress(OSError):
        if sys.stderr.isatty():
            columns = max(shutil.get_terminal_size().columns, _LEAST)
            line = textwrap.fill(
                line, columns, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
            )
        print(line, file=sys.stderr, flush=True)


def printable(text: str) -> str:
    """Return text with escapes for what a terminal would obey: what a file says may hold such characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _fail(error: object, code: int) -> int:
    say(f"strand: error: {' '.join(str(error).split())}")
    return code
