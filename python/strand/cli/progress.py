"""The progress of a command, on stderr: a display of stages on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec

from strand.cli.terminal import print_message
from strand.support.extras import import_extra

_DELAY = 1.0  # seconds before the display appears, so that short work shows none
_PERIOD = 0.1  # seconds between two updates of the display


@contextmanager
def show_progress(first: str | None = None) -> Iterator[Callable[[str], None]]:
    """Show stages as they start, until the context ends.

    On a terminal with rich installed, work of more than a second shows its stages and their times; the
    display vanishes at the end. Elsewhere each stage is a line.

    Parameters
    ----------
    first : str, optional
        The work before the first stage, for the display only.

    Yields
    ------
    callable
        Call it with the name of each stage that starts.
    """
    if not sys.stderr.isatty() or find_spec("rich") is None:
        yield lambda stage: print_message(f"strand: {stage}")
        return
    begun = [] if first is None else [(first, time.monotonic())]
    ended = threading.Event()
    # the kernels release the GIL, so a thread can update the display while they work
    display = threading.Thread(target=_run_display, args=(begun, ended), daemon=True)
    display.start()
    try:
        yield lambda stage: begun.append((stage, time.monotonic()))
    finally:
        ended.set()
        display.join()


def _run_display(begun: Sequence[tuple[str, float]], ended: threading.Event) -> None:
    """Show the names and start times of stages until `ended` is set."""
    if ended.wait(_DELAY):
        return
    console = import_extra("rich.console").Console(stderr=True)
    with (
        suppress(OSError),  # the work goes on without a terminal
        import_extra("rich.live").Live(console=console, transient=True, auto_refresh=False) as live,
    ):
        while not ended.wait(_PERIOD):
            live.update(_format_stages(list(begun), time.monotonic()), refresh=True)


def _format_stages(begun: Sequence[tuple[str, float]], now: float) -> str:
    """Return one line per stage with its duration so far, seconds."""
    ends = [start for _, start in begun[1:]] + [now]
    return "\n".join(
        f"{name:<12}{end - start:7.1f} s" for (name, start), end in zip(begun, ends, strict=True)
    )
