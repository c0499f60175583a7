"""Links from a page about a batch to its recordings and to reports about them."""

from __future__ import annotations

import html
import os
import re
from pathlib import Path
from urllib.parse import quote

_REPORT = ".html"
_FOLDER_REPORT = "report.html"  # in a recording that is a folder


class Links:
    """Finds the files to which a page links; a name without a file stays text.

    Parameters
    ----------
    page : path
        The page, whose folder the links start from.
    root : path or None
        The folder to which names of recordings relate; None if it is unknown.
    """

    def __init__(self, page: str | os.PathLike[str], root: Path | None) -> None:
        self.page = Path(os.path.abspath(page))
        self.root = root

    def make_cell(self, recording: str) -> str:
        """Return HTML of a recording's name: with links to it and to its report, if these exist."""
        path, text = self._find_recording(recording), html.escape(recording)
        cell = text if path is None else self._link(path, text)
        report = next(iter(self._list_reports(recording, path)), None)
        return cell if report is None else f"{cell} ({self._link(report, 'report')})"

    def _find_recording(self, recording: str) -> Path | None:
        path = Path(decode_name(recording))
        if not path.is_absolute():
            if self.root is None:
                return None
            path = self.root / path
        return path if _exists(path) else None

    def _list_reports(self, recording: str, path: Path | None) -> list[Path]:
        """Return the reports in or beside the recording, or at its name beside the page."""
        places = [] if path is None else [path]
        if not Path(name := decode_name(recording)).is_absolute():
            places.append(self.page.parent / name)
        found = [] if path is None else [path / _FOLDER_REPORT]
        for place in places:
            if place.name:
                found += [place.with_suffix(_REPORT), place.with_name(place.name + _REPORT)]
        return [report for report in found if report != self.page and _exists(report)]

    def _link(self, path: Path, text: str) -> str:
        try:
            relative = Path(os.path.relpath(path, self.page.parent)).as_posix()
        except ValueError:
            return text  # another drive of Windows
        # every byte but letters, digits and "/_.-~" is escaped: no name becomes a scheme or a query
        return f'<a href="{quote(os.fsencode(relative))}">{text}</a>'


def decode_name(recording: str) -> str:
    """Return the path that a recording's name in a table stands for."""

    def decode(match: re.Match[bytes]) -> bytes:
        code = match[1]
        return code if code == b"\\" else bytes([int(code[1:], 16)])

    return os.fsdecode(re.sub(rb"\\(\\|x[0-9a-f]{2})", decode, recording.encode()))


def _exists(path: Path) -> bool:
    try:
        return path.exists()
    except (OSError, ValueError):
        return False  # a name that is too long, or one with a zero byte
