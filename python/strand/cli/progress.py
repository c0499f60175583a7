"""What is at work, on stderr: a bar on a terminal, lines elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

from strand.cli.outcome import say
from strand.files import extra


@contextmanager
def progress(stages: int) -> Iterator[Callable[[str], None]]:
    """Show so many stages as they start: a bar on a terminal, lines elsewhere or without rich."""
    if not sys.stderr.isatty() or find_spec("rich") is None:
        yield lambda stage: say(f"strand: {stage}")
        return
    console = extra("rich.console").Console(stderr=True)
    rich = extra("rich.progress")
    columns = (rich.SpinnerColumn(), rich.TextColumn("{task.description:<10}"), rich.BarColumn())
    with rich.Progress(*columns, console=console, transient=True) as display:
        task = display.add_task("", total=stages, completed=-1)
        yield lambda stage: display.update(task, description=stage, advance=1)
