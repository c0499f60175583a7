"""The standard streams: messages on stderr, and text that is safe to print."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from contextlib import suppress
from io import TextIOWrapper

_MIN_COLUMNS = 30  # columns that a message gets on however narrow a terminal


def open_closed_streams() -> None:
    """Redirect standard streams that the caller closed to the null device; let stdout print any file name."""
    sys.stdout = sys.stdout or open(os.devnull, "w")  # noqa: SIM115
    sys.stderr = sys.stderr or open(os.devnull, "w")  # noqa: SIM115
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def flush_before_message() -> None:
    """Flush stdout, so that its text stands above the next message; `flush_output` reports a failure."""
    with suppress(OSError):
        sys.stdout.flush()


def print_message(line: str) -> None:
    """Print a line to stderr, wrapped between words on a terminal; ignore a stderr that cannot be written."""
    line = escape_unprintable(line)
    with suppress(OSError):
        if sys.stderr.isatty():
            columns = max(shutil.get_terminal_size().columns, _MIN_COLUMNS)
            line = textwrap.fill(
                line, columns, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False
            )
        print(line, file=sys.stderr, flush=True)


def escape_unprintable(text: str) -> str:
    """Return text with control characters escaped: a file may hold ones that a terminal would obey."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
