"""Hooks of the documentation site: pages outside `docs/`, links between them, nothing from the network.

mkdocs calls the functions `on_...` while it builds. A warning ends the build.
"""

from __future__ import annotations

import logging
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
# pages outside of docs/, and their names in the site
PAGES = {
    "README.md": "index.md",
    "examples/README.md": "examples.md",
    "packaging/README.md": "wheels.md",
    "ros/README.md": "ros.md",
} | {
    f"{name.upper()}.md": f"{name}.md"
    for name in ("architecture", "changelog", "contributing", "releasing", "security")
}
LINK = re.compile(r"\[([^][]*)\]\((?!\w+:)([^()#\s]+)(#[^()\s]*)?\)")
# attributes whose addresses a browser fetches
FETCHED = {("script", "src"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("link", "href")}
RESULTS = sorted((ROOT / "benches" / "results").glob("*.md"))
PAGES |= {path.relative_to(ROOT).as_posix(): f"results/{path.name}" for path in RESULTS}
log = logging.getLogger("mkdocs.plugins.site")


def anchor(heading: str, _separator: str = "-") -> str:
    """Return a heading's name in links, as hosts of repositories name it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def on_config(config: Any) -> Any:
    """Let mkdocs name headings by `anchor`."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = anchor
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages outside of docs/."""
    for name, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Point links at pages of the site, and name files that are no pages."""
    for name, title in PAGES.items():
        if page.file.src_uri == title:
            return relinked(markdown, (ROOT / name).parent, in_docs=False)
    return relinked(markdown, (DOCS / page.file.src_uri).parent, in_docs=True)


def relinked(markdown: str, folder: Path, in_docs: bool) -> str:
    """Rewrite the links of a page in a folder of the repository."""

    def rewritten(match: re.Match[str]) -> str:
        text, target, place = match.group(1), match.group(2), match.group(3) or ""
        path = (folder / target).resolve()
        if path.is_relative_to(DOCS):
            return match.group() if in_docs else f"[{text}]({path.relative_to(DOCS).as_posix()}{place})"
        if not path.exists():
            return match.group()
        name = path.relative_to(ROOT).as_posix()
        if name in PAGES:
            up = "../" * len(folder.relative_to(DOCS).parts) if in_docs else ""
            return f"[{text}]({up}{PAGES[name]}{place})"
        return f"`{name}`" if text == name else f"{text} (`{name}`)"

    return LINK.sub(rewritten, markdown)


class _Addresses(HTMLParser):
    """Collects the remote addresses that a page fetches."""

    def __init__(self) -> None:
        super().__init__()
        self.remote: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if (tag, name) in FETCHED and re.match(r"(https?:)?//", value or ""):
                self.remote.append(str(value))


def find_remote(html: str) -> list[str]:
    """Return the remote addresses of a page's scripts, styles, fonts and images."""
    parser = _Addresses()
    parser.feed(html)
    return parser.remote


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Warn of everything that a page would fetch."""
    for address in find_remote(output):
        log.warning("%s fetches %s", page.file.dest_uri, address)
    return output
