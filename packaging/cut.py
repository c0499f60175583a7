"""Cut a release: write its version and date, and move "Unreleased" of the changelog under it.

python packaging/cut.py VERSION

The version is that of Cargo.toml; Cargo.lock and CITATION.cff repeat it. Commits nothing and tags nothing.
"""

from __future__ import annotations

import datetime
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
EMPTY = "Nothing yet."


def cut(root: Path, version: str, day: str) -> None:
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        raise ValueError(f"version: expected three numbers such as 0.2.0, got {version!r}")
    changelog = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    head, mark, rest = changelog.partition("## Unreleased\n\n")
    if not mark or rest.startswith((EMPTY, "## ")):
        raise ValueError("CHANGELOG.md: nothing is under Unreleased")
    if re.search(rf"^## {re.escape(version)} ", rest, re.MULTILINE):
        raise ValueError(f"CHANGELOG.md: {version} is there already")
    written = {
        "CHANGELOG.md": f"{head}{mark}{EMPTY}\n\n## {version} - {day}\n\n{rest}",
        "Cargo.toml": replaced(root / "Cargo.toml", r'(?m)(?<=^version = ")[^"]+', version),
        "Cargo.lock": replaced(root / "Cargo.lock", r'(?<=\nname = "strand"\nversion = ")[^"]+', version),
        "CITATION.cff": replaced(
            root / "CITATION.cff",
            r"(?m)^version: .+\n(date-released: .+\n)?",
            f"version: {version}\ndate-released: {day}\n",
        ),
    }
    for name, text in written.items():
        (root / name).write_text(text, encoding="utf-8")


def replaced(path: Path, pattern: str, new: str) -> str:
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
