"""What benches share as programs: the parser, and files in benches/results that keep their output."""

from __future__ import annotations

import argparse
import contextlib
import io
import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

RESULTS = Path(__file__).resolve().parents[1] / "results"
WRITE = "--write"


class Copy(io.StringIO):
    """Keeps all text, and passes it on."""

    def __init__(self, onward: io.TextIOBase) -> None:
        super().__init__()
        self.onward = onward

    def write(self, text: str) -> int:
        self.onward.write(text)
        return super().write(text)

    def flush(self) -> None:
        self.onward.flush()


def make_parser(documentation: str) -> argparse.ArgumentParser:
    """Return the parser of a bench, described by the first line of its documentation."""
    parser = argparse.ArgumentParser(description=documentation.splitlines()[0])
    parser.add_argument(WRITE, action="store_true", help="keep the output in benches/results/")
    return parser


def run_bench(main: Callable[[], int | None]) -> None:
    """Run a bench as a program; with `--write` keep what it prints, if it ends without an error."""
    if WRITE not in sys.argv[1:]:
        sys.exit(main())
    copy = Copy(sys.stdout)
    with contextlib.redirect_stdout(copy):
        code = main()
    script = Path(sys.argv[0])
    options = [option for option in sys.argv[1:] if option != WRITE]
    title = (sys.modules["__main__"].__doc__ or script.stem).splitlines()[0]
    path = RESULTS / f"{script.stem}.md"
    before = path.read_text(encoding="utf-8") if path.exists() else f"# {title}\n"
    command = shlex.join(["python", f"benches/{script.name}", *options])
    path.parent.mkdir(exist_ok=True)
    path.write_text(replace_section(before, command, copy.getvalue()), encoding="utf-8")
    sys.exit(code)


def replace_section(page: str, command: str, output: str) -> str:
    """Return a page of results with a command's output in place of its earlier output, or at the end."""
    section = f"## `{command}`\n\n{output.strip()}\n"
    parts = re.split(r"^(?=## )", page, flags=re.MULTILINE)
    heading = section.splitlines()[0]
    kept = [part.strip() + "\n" for part in parts]
    places = [place for place, part in enumerate(kept) if part.splitlines()[0] == heading]
    kept[places[0] if places else len(kept) :] = [section, *(kept[places[0] + 1 :] if places else [])]
    return "\n".join(kept)
