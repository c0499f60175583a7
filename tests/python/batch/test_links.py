"""Links on the page about a batch: to recordings and reports that exist, whatever their names."""

from __future__ import annotations

import html
import os
import re
import shutil
import sys
from pathlib import Path
from urllib.parse import unquote_to_bytes

import pytest

from shared.batch_recordings import SETTINGS
from strand.batch import run, write_summary
from strand.batch.links import Links, decode_name
from strand.batch.units import _name_recording

ODD_NAMES = (
    b"plain.npz",
    b"javascript:alert(1).npz",
    b"a#b?c%41&amp;.npz",
    b"<img src=x onerror=alert(1)>.npz",
    "\"knöt' \u202e.npz".encode(),
    b"back\\slash\\x41.npz",
    *((b"not \xff utf-8.npz",) if sys.platform == "linux" else ()),
)


def follow(page: Path) -> list[tuple[str, Path]]:
    """Return the text of each link of a page and the file to which it leads."""
    found = re.findall(r'<a href="([^"]*)">(.*?)</a>', page.read_text(encoding="utf-8"))
    assert all(re.fullmatch(r"[\w/.~%-]+", target) for target, _ in found)
    places = [os.fsdecode(unquote_to_bytes(target)) for target, _ in found]
    return [
        (html.unescape(text), Path(os.path.normpath(page.parent / place)))
        for place, (_, text) in zip(places, found, strict=True)
    ]


@pytest.mark.parametrize("name", ODD_NAMES)
def test_names_are_links_to_their_files(tmp_path, name):
    path = tmp_path / "in" / os.fsdecode(name)
    path.parent.mkdir()
    path.write_bytes(b"nonsense")
    run(tmp_path / "in", tmp_path / "out", SETTINGS, root=tmp_path / "in")
    page = tmp_path / "pages" / "page.html"
    page.parent.mkdir()
    write_summary(tmp_path / "out", page)
    recording = _name_recording(str(path), tmp_path / "in")
    assert decode_name(recording) == path.name
    # in the tables of errors and of the slowest frames
    assert follow(page) == [(recording, path)] * 2
    assert "<img" not in page.read_text(encoding="utf-8")
    path.unlink()
    write_summary(tmp_path / "out", page)
    assert follow(page) == []


def test_reports_are_found_beside_recordings_and_beside_the_page(tmp_path):
    folder = tmp_path / "in"
    for name in ("a/bag/rope.db3", "b.npz", "c.npz", "d.npz", "bare.npz", "page.npz"):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    page = tmp_path / "page.html"
    reports = {
        "a/bag": folder / "a" / "bag" / "report.html",
        "b.npz": folder / "b.html",
        "c.npz": folder / "c.npz.html",
        "d.npz": tmp_path / "d.html",
        "gone.npz": tmp_path / "gone.npz.html",
    }
    for report in reports.values():
        report.touch()
    links = Links(page, folder)
    cells = [links.make_cell(name) for name in (*reports, "bare.npz", "page.npz")]
    page.write_text("".join(cells))
    wanted = [pair for name, path in reports.items() for pair in ((name, folder / name), ("report", path))]
    wanted.remove(("gone.npz", folder / "gone.npz"))
    assert follow(page) == [*wanted, ("bare.npz", folder / "bare.npz"), ("page.npz", folder / "page.npz")]


def test_recordings_outside_the_root_are_links_too(tmp_path):
    (tmp_path / "b.npz").touch()
    whole = (tmp_path / "b.npz").as_posix()
    (tmp_path / "page.html").write_text(Links(tmp_path / "page.html", None).make_cell(whole))
    assert follow(tmp_path / "page.html") == [(whole, tmp_path / "b.npz")]


@pytest.mark.parametrize("name", ["b.npz", "\0", "x" * 10_000, "..", "."])
def test_names_without_a_file_or_root_stay_text(tmp_path, name):
    (tmp_path / "b.npz").touch()
    assert Links(tmp_path / "page.html", None).make_cell(name) == name


def test_a_table_whose_root_is_gone_has_no_links(tmp_path):
    folder = tmp_path / "in"
    folder.mkdir()
    (folder / "b.npz").write_bytes(b"nonsense")
    run(folder, tmp_path / "out", SETTINGS, root=folder)
    shutil.rmtree(folder)
    write_summary(tmp_path / "out", tmp_path / "page.html")
    assert follow(tmp_path / "page.html") == []
    (tmp_path / "out" / "_root.json").write_text("{")
    write_summary(tmp_path / "out", tmp_path / "page.html")
