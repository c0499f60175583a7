"""Write the tables of docs/configuration.md from the dataclasses of strand.config and their docstrings.

python docs/making/configuration.py
"""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import sys
from pathlib import Path

from strand import Config

PAGE = Path(__file__).resolve().parents[1] / "configuration.md"
MADE = "<!-- From here on the page is made by docs/making/configuration.py: change the docstrings. -->\n"
SECTION = re.compile(r"\n(?:Parameters|Raises)\n-+\n")
FIELD = re.compile(r"^(\w+) : .+\n((?: {4}.+\n?)+)", re.MULTILINE)


def read_docstring(kind: type) -> tuple[str, dict[str, str]]:
    """Return a dataclass's summary and the text of each field."""
    text, fields = SECTION.split(inspect.getdoc(kind) or "")[:2]
    return escape(text), {name: escape(words) for name, words in FIELD.findall(fields)}


def format_default(default: object, meaning: str) -> str:
    """Write a default as a table shows it: angles in degrees too."""
    if default is None:
        return "none"
    if isinstance(default, str):
        return f'`"{default}"`'
    if isinstance(default, float) and "radians" in meaning:
        return f"{math.degrees(default):g}° ({default:.3g})"
    return repr(default)


def format_table(kind: type, names: list[str]) -> str:
    """Rows for some fields of a dataclass: name, default, meaning."""
    meanings = read_docstring(kind)[1]
    defaults = {entry.name: entry.default for entry in dataclasses.fields(kind)}
    rows = [
        f"| `{name}` | {format_default(defaults[name], meanings[name])} | {meanings[name]} |"
        for name in names
    ]
    return "\n".join(["| field | default | meaning |", "|---|---|---|", *rows])


def escape(text: str) -> str:
    """Text of a docstring as one line of Markdown."""
    return " ".join(text.split()).replace("*", r"\*")


def rewrite(page: str) -> str:
    """Return the page with its tables made anew; what stands above them stays."""
    head, found, _ = page.partition(MADE)
    if not found:
        raise SystemExit(f"{PAGE.name}: expected the line {MADE.strip()!r}")
    sections = {
        entry.name: type(getattr(Config(), entry.name))
        for entry in dataclasses.fields(Config)
        if entry.default is dataclasses.MISSING
    }
    alone = [entry.name for entry in dataclasses.fields(Config) if entry.name not in sections]
    parts = [format_table(Config, alone)]
    for name, kind in sections.items():
        names = [entry.name for entry in dataclasses.fields(kind)]
        parts.append(
            f"## `{name}`: {kind.__name__}\n\n{read_docstring(kind)[0]}\n\n{format_table(kind, names)}"
        )
    return head + MADE + "\n" + "\n\n".join(parts) + "\n"


def main() -> int:
    PAGE.write_text(rewrite(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
