"""Pages of the documentation site: links, names of headings, nothing from the network."""

from __future__ import annotations

import griffe
import pytest
from docstrings import Habits
from site_pages import DOCS, PAGES, ROOT, anchor, find_remote, on_post_page, relinked

import strand


@pytest.mark.parametrize(
    ("folder", "link", "want"),
    [
        (ROOT, "[a](docs/files.md#errors-and-limits)", "[a](files.md#errors-and-limits)"),
        (ROOT, "![a](docs/images/real.png)", "![a](images/real.png)"),
        (ROOT, "[a](CONTRIBUTING.md#workflows)", "[a](contributing.md#workflows)"),
        (ROOT, "[pages](tests/data/README.md)", "pages (`tests/data/README.md`)"),
        (DOCS, "[a](../SECURITY.md)", "[a](security.md)"),
        (DOCS / "api", "[a](../../README.md)", "[a](../index.md)"),
        (DOCS / "api", "[a](../files.md)", "[a](../files.md)"),
        (DOCS, "[benches/lib/measure.py](../benches/lib/measure.py)", "`benches/lib/measure.py`"),
        (DOCS, "[a](#place) [b](https://kiddo.rs/a.md)", "[a](#place) [b](https://kiddo.rs/a.md)"),
        (DOCS, "[a](../nowhere.md)", "[a](../nowhere.md)"),
        (DOCS, "[a](../packaging/README.md#build)", "[a](wheels.md#build)"),
        (ROOT / "packaging", "[a](../docs/files.md)", "[a](files.md)"),
    ],
)
def test_links_lead_to_pages_of_the_site(folder, link, want):
    assert relinked(link, folder, folder.is_relative_to(DOCS)) == want


def test_every_page_at_the_root_is_in_the_site():
    assert {path.name for path in ROOT.glob("*.md")} <= set(PAGES)
    assert all((ROOT / page).is_file() for page in PAGES)


def test_headings_are_called_as_where_the_repository_is_hosted():
    assert anchor("Where is …?") == "where-is-"
    assert anchor("`filter`: Filter") == "filter-filter"


def test_a_page_that_fetches_something_is_warned_of(caplog):
    class Page:
        class file:
            dest_uri = "a.html"

    html = """<a href="https://a.org">a</a><img src="images/a.png"><script src="assets/a.js"></script>
        <link rel="stylesheet" href="https://b.org/b.css"><img src="//c.org/c.png">"""
    assert find_remote(html) == ["https://b.org/b.css", "//c.org/c.png"]
    assert on_post_page(html, Page) == html
    assert [record.getMessage() for record in caplog.records] == [
        "a.html fetches https://b.org/b.css",
        "a.html fetches //c.org/c.png",
    ]


@pytest.fixture(scope="module")
def read():
    """Return the package as the site's API pages see it."""
    extensions = griffe.load_extensions(Habits())
    return griffe.load("strand", extensions=extensions, allow_inspection=False)


def test_kernels_have_their_documentation(read):
    for name in ("icp", "estimate_normals", "IcpResult", "TubeFit", "EndObservation"):
        said = read[f"_core.{name}"].docstring.value
        assert said.splitlines()[0] == getattr(strand, name).__doc__.splitlines()[0]
    assert read["_core.IcpResult.fitness"].docstring.value.startswith("float: share of")
    assert [p.name for p in read["_core.EndObservation"].parameters][1:3] == ["view", "end"]
    assert read["_core.estimate_normals"].parameters["variation"].default == "False"
    assert ': one of "raise", "drop"\n' in read["_core.icp"].docstring.value


def test_lazy_properties_are_attributes(read):
    assert read["geometry.line.Line.tangents"].is_attribute
    assert read["geometry.line.Line.at"].is_function


def test_no_module_hides_a_public_name(read):
    for package in ("synthetic", "figures"):
        names = getattr(strand, package).__all__
        assert [name for name in names if read[package].members[name].is_module] == []
