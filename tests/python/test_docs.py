"""The pages say what the code says: numbers of the configuration, rooms, links."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path

import collection
import pytest

import strand
from strand import config

ROOT = Path(__file__).resolve().parents[2]
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
LINKS = [(page, link) for page in PAGES for link in re.findall(r"\]\((?!https?:)([^)]+)\)", page.read_text())]
CONFIGURATION = (ROOT / "docs" / "configuration.md").read_text()
SECTIONS = {
    entry.name: type(getattr(strand.Config(), entry.name))
    for entry in dataclasses.fields(strand.Config)
    if entry.name not in ("method", "sensor")
}


def written(default):
    """The value that a default in a table stands for."""
    if default == "none":
        return None
    if default.startswith('`"'):
        return default.strip('`"')
    if match := re.fullmatch(r"([\d.]+)° \(([\d.]+)\)", default):
        degrees, radians = map(float, match.groups())
        assert math.radians(degrees) == pytest.approx(radians, rel=1e-3)
        return math.radians(degrees)
    return float(default)


def rows(text):
    return re.findall(r"^\| `(\w+)` \| (.+?) \| .+ \|$", text, re.MULTILINE)


def test_the_configuration_page_has_every_section_in_order():
    headings = re.findall(r"^## `(\w+)`: (\w+)$", CONFIGURATION, re.MULTILINE)
    assert headings == [(name, section.__name__) for name, section in SECTIONS.items()]
    assert rows(CONFIGURATION.split("\n## ")[0]) == [("method", '`"tubes"`'), ("sensor", "none")]
    assert (strand.Config().method, strand.Config().sensor) == ("tubes", None)


@pytest.mark.parametrize("name", SECTIONS)
def test_the_configuration_page_has_every_field_with_its_default(name):
    text = re.split(r"^## ", CONFIGURATION.split(f"\n## `{name}`: ")[1], flags=re.MULTILINE)[0]
    said = {field: written(default) for field, default in rows(text)}
    fields = dataclasses.fields(SECTIONS[name])
    assert len(rows(text)) == len(said)
    assert said == {entry.name: entry.default for entry in fields}


def test_the_examples_of_the_configuration_page_are_one(tmp_path):
    (python,) = re.findall(r"```python\n(.*?)```", CONFIGURATION, re.DOTALL)
    (toml,) = re.findall(r"```toml\n(.*?)```", CONFIGURATION, re.DOTALL)
    path = tmp_path / "numbers.toml"
    path.write_text(toml)
    names = {}
    exec(python.split("model =")[0], names)
    assert names["config"] == config.load(path) != strand.Config()


def anchors(page):
    """What the headings of a page are called in links."""
    headings = re.findall(r"^#+ (.+)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(("page", "link"), LINKS, ids=lambda part: getattr(part, "name", part))
def test_links_lead_somewhere(page, link):
    target, _, anchor = link.partition("#")
    path = page.parent / target if target else page
    assert path.exists()
    assert not anchor or anchor in anchors(path)


def test_there_are_links_to_be_checked():
    assert {page.name for page, _ in LINKS} >= {"README.md", "ARCHITECTURE.md", "benchmarks.md", "method.md"}


def test_the_architecture_names_every_room():
    said = (ROOT / "ARCHITECTURE.md").read_text()
    package = ROOT / "python" / "strand"
    rooms = [path for path in package.rglob("*.py") if not path.name.startswith("__")]
    assert len(rooms) > 50
    assert [path.name for path in rooms if f"{path.name}`" not in said] == []


@pytest.mark.parametrize("command", ["python benches/scenes.py\n", "python benches/scenes.py --published\n"])
def test_tables_of_scenes_have_all_scenes_of_the_collection(command):
    after = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8").split(command, 1)[1]
    table = after.split("\n\n", 2)[1].splitlines()
    assert table[0].startswith("| scene | topology |")
    assert [row.split("|")[1].strip() for row in table[2:]] == list(collection.names())
