"""Pages and code agree: numbers of the configuration, public names, folders, links."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import configuration
import pytest

import strand
from lib import collection

ROOT = Path(__file__).resolve().parents[3]
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "examples" / "README.md",
    ROOT / "packaging" / "README.md",
    ROOT / "ros" / "README.md",
]
LINKS = [(page, link) for page in PAGES for link in re.findall(r"\]\((?!https?:)([^)]+)\)", page.read_text())]


def test_the_configuration_page_says_what_the_dataclasses_say():
    page = configuration.PAGE.read_text(encoding="utf-8")
    assert page == configuration.rewrite(page), "run python docs/making/configuration.py"


def test_the_configuration_page_has_every_field_with_its_default():
    page = configuration.PAGE.read_text(encoding="utf-8")
    assert "| `threshold` | 3.2 | A minimum above this is no crossing, in rope radii. Strands" in page
    assert "| `rotation_sd` | 0.5° (0.00873) | Standard deviation of each component of the rotation" in page
    assert '| `rings` | `"maybe"` | `"maybe"` lets the data decide' in page
    sections = re.findall(r"^## `(\w+)`: (\w+)\n\n.+\n\n((?:\|.+\n)+)", page, re.MULTILINE)
    assert [name for name, _, _ in sections] == [
        entry.name for entry in dataclasses.fields(strand.Config) if entry.name not in ("method", "sensor")
    ]
    for name, kind, rows in sections:
        section = getattr(strand.Config(), name)
        assert type(section).__name__ == kind
        assert re.findall(r"^\| `(\w+)`", rows, re.MULTILINE) == [e.name for e in dataclasses.fields(section)]


def list_anchors(page):
    """Return the names of a page's headings in links."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(("page", "link"), LINKS, ids=lambda part: getattr(part, "name", part))
def test_links_lead_somewhere(page, link):
    target, _, anchor = link.partition("#")
    path = page.parent / target if target else page
    assert path.exists()
    assert not anchor or anchor in list_anchors(path)


def test_there_are_links_to_be_checked():
    assert {page.name for page, _ in LINKS} >= {"README.md", "ARCHITECTURE.md", "benchmarks.md", "method.md"}


def test_every_public_name_is_on_an_api_page():
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.md"))
    shown = re.findall(r"^::: ([\w.]+)$", pages, re.MULTILINE)
    assert len(shown) == len(set(shown))
    assert {f"strand.{name}" for name in strand.__all__} - set(shown) == {"strand.__version__"}
    assert "`strand.__version__`" in pages


ARCHITECTURE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("folder", ["python/strand", "python/strand/reconstruction", "rust/src"])
def test_the_architecture_names_every_folder(folder):
    folders = [path.name for path in (ROOT / folder).iterdir() if path.is_dir() and path.name[0] != "_"]
    assert len(folders) > 5
    assert [name for name in folders if f"`{name}/`" not in ARCHITECTURE] == []


def test_the_files_that_the_architecture_names_exist():
    package = ROOT / "python" / "strand"
    places = [
        ROOT,
        package,
        package / "reconstruction",
        *(package / "reconstruction").iterdir(),
        ROOT / "rust" / "src",
    ]
    named = re.findall(r"`([\w/.]+(?:/|\.\w+))`", ARCHITECTURE)
    files = [name for name in named if name.endswith(("/", ".py", ".rs", ".pyi", ".md", ".yml"))]
    assert len(files) > 50
    assert [name for name in files if not any((place / name).exists() for place in places)] == []


@pytest.mark.parametrize("command", ["python benches/scenes.py", "python benches/scenes.py --published"])
def test_tables_of_scenes_have_all_scenes_of_the_collection(command):
    page = ROOT / "benches" / "results" / "scenes.md"
    after = page.read_text(encoding="utf-8").split(f"## `{command}`\n\n", 1)[1]
    table = after.split("\n\n", 1)[0].splitlines()
    assert table[0].startswith("| scene | topology |")
    assert [row.split("|")[1].strip() for row in table[2:]] == list(collection.list_names())


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_files_that_a_page_names_exist(page):
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`((?:tests|benches|docs|examples|packaging|rust|python/strand)/[\w./]+)`", text)
    assert [name for name in named if "NAME" not in name and not (ROOT / name).exists()] == []
