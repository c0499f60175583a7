"""What is at work, on stderr: stages with their times on a terminal, if that lasts; lines elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec

from strand.cli.outcome import say
from strand.support.extras import import_extra

# seconds before anything is shown, so that nothing flashes, and from one picture to the next
_PATIENCE, _EVERY = 1.0, 0.1


@contextmanager
def progress(first: str | None = None) -> Iterator[Callable[[str], None]]:
    """Show stages as they start, until the context ends.

    On a terminal, and if rich is installed, what lasts more than a second is shown with the time that each
    stage took, and taken away at the end. Elsewhere each stage is a line.

    Parameters
    ----------
    first : str, optional
        What is at work before a stage starts; on terminals only.

    Yields
    ------
    callable
        Is called with each stage's name when it starts.
    """
    if not sys.stderr.isatty() or find_spec("rich") is None:
        yield lambda stage: say(f"strand: {stage}")
        return
    begun = [] if first is None else [(first, time.monotonic())]
    ended = threading.Event()
    # kernels release the GIL: a thread can show what is at work meanwhile
    display = threading.Thread(target=_show, args=(begun, ended), daemon=True)
    display.start()
    try:
        yield lambda stage: begun.append((stage, time.monotonic()))
    finally:
        ended.set()
        display.join()


def _show(begun: Sequence[tuple[str, float]], ended: threading.Event) -> None:
    """Show stages and when they began until they end."""
    if ended.wait(_PATIENCE):
        return
    console = import_extra("rich.console").Console(stderr=True)
    with (
        suppress(OSError),  # a terminal that is gone is no reason to stop
        import_extra("rich.live").Live(console=console, transient=True, auto_refresh=False) as live,
    ):
        while not ended.wait(_EVERY):
            live.update(_lines(list(begun), time.monotonic()), refresh=True)


def _lines(begun: Sequence[tuple[str, float]], now: float) -> str:
    """Return a line for each stage, and how long it took or has lasted."""
    ends = [start for _, start in begun[1:]] + [now]
    return "\n".join(
        f"{name:<12}{end - start:7.1f} s" for (name, start), end in zip(begun, ends, strict=True)
    )
