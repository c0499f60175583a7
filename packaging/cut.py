"""Cut a release: write its version and date, and move "Unreleased" of the changelog under it.

python packaging/cut.py VERSION

The version is in Cargo.toml; Cargo.lock and CITATION.cff repeat it. The script neither commits nor tags.
"""

from __future__ import annotations

import datetime
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EMPTY = "Nothing yet."


def cut(root: Path, version: str, day: str) -> None:
    """Write a version and its day into all files, or refuse before anything is written."""
    number = r"(0|[1-9]\d*)"
    if not re.fullmatch(rf"{number}\.{number}\.{number}", version, re.ASCII):
        raise ValueError(f"version: expected three numbers without leading zeros, as 0.2.0, got {version!r}")
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    head, mark, rest = changelog.partition("## Unreleased\n\n")
    if not mark or rest.startswith((EMPTY, "## ")):
        raise ValueError("CHANGELOG.md: nothing is under Unreleased")
    if re.search(rf"^## {re.escape(version)} ", rest, re.MULTILINE):
        raise ValueError(f"CHANGELOG.md: {version} exists already")
    (now,) = re.findall(r'(?m)^version = "([^"]+)', (root / "Cargo.toml").read_text(encoding="utf-8"))
    # the same version is fine while the changelog does not have it
    if parse_version(version) < parse_version(now):
        raise ValueError(f"version: expected {now}, which is in Cargo.toml, or a higher one, got {version}")
    written = {
        "CHANGELOG.md": f"{head}{mark}{EMPTY}\n\n## {version} - {day}\n\n{rest}",
        "Cargo.toml": replace_once(root / "Cargo.toml", r'(?m)(?<=^version = ")[^"]+', version),
        "Cargo.lock": replace_once(root / "Cargo.lock", r'(?<=\nname = "strand"\nversion = ")[^"]+', version),
        "CITATION.cff": replace_once(
            root / "CITATION.cff",
            r"(?m)^version: .+\n(date-released: .+\n)?",
            f"version: {version}\ndate-released: {day}\n",
        ),
    }
    for name, text in written.items():
        (root / name).write_text(text, encoding="utf-8")


def parse_version(version: str) -> list[int]:
    """Return the numbers of a version."""
    return [int(number) for number in version.split(".")]


def replace_once(path: Path, pattern: str, new: str) -> str:
    """Return a file's text with the one match of a pattern replaced."""
    text, count = re.subn(pattern, new, path.read_text(encoding="utf-8"))
    if count != 1:
        raise ValueError(f"{path.name}: expected one place of the version, got {count}")
    return text


def main() -> int:
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    try:
        cut(ROOT, sys.argv[1], datetime.datetime.now(datetime.timezone.utc).date().isoformat())
    except ValueError as error:
        sys.exit(f"cut.py: {error}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
