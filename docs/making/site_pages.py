"""What the documentation site needs beside mkdocs: the pages at the root, and nothing from the network.

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
# pages that lie at the root of the repository, and what they are called in the site
PAGES = {"README.md": "index.md"} | {
    f"{name.upper()}.md": f"{name}.md"
    for name in ("architecture", "changelog", "contributing", "releasing", "security")
}
LINK = re.compile(r"\[([^][]*)\]\((?!\w+:)([^()#\s]+)(#[^()\s]*)?\)")
# attributes by which a page takes something from elsewhere when it is shown
TAKEN = {("script", "src"), ("img", "src"), ("iframe", "src"), ("source", "src"), ("link", "href")}
log = logging.getLogger("mkdocs.plugins.site")


def anchor(heading: str, _separator: str = "-") -> str:
    """What a heading is called in links: the same here as where the repository is hosted."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def on_config(config: Any) -> Any:
    """Name headings as links do."""
    config.mdx_configs.setdefault("toc", {})["slugify"] = anchor
    return config


def on_files(files: Any, config: Any) -> Any:
    """Add the pages at the root of the repository."""
    for name, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Let links lead to pages of the site; files of the repository are named instead."""
    if page.file.src_uri in PAGES.values():
        return relinked(markdown, ROOT, in_docs=False)
    return relinked(markdown, (DOCS / page.file.src_uri).parent, in_docs=True)


def relinked(markdown: str, folder: Path, in_docs: bool) -> str:
    """Rewrite the links of a page that lies in a folder of the repository."""

    def rewritten(match: re.Match[str]) -> str:
        text, target, place = match.group(1), match.group(2), match.group(3) or ""
        path = (folder / target).resolve()
        if path.is_relative_to(DOCS):
            return match.group() if in_docs else f"[{text}]({path.relative_to(DOCS).as_posix()}{place})"
        if path.parent == ROOT and path.name in PAGES:
            up = "../" * len(folder.relative_to(DOCS).parts) if in_docs else ""
            return f"[{text}]({up}{PAGES[path.name]}{place})"
        if not path.exists():
            return match.group()
        name = path.relative_to(ROOT).as_posix()
        return f"`{name}`" if text == name else f"{text} (`{name}`)"

    return LINK.sub(rewritten, markdown)


class _Taken(HTMLParser):
    """Collects what a page takes from other places."""

    def __init__(self) -> None:
        super().__init__()
        self.remote: list[str] = []

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        for name, value in attributes:
            if (tag, name) in TAKEN and re.match(r"(https?:)?//", value or ""):
                self.remote.append(str(value))


def taken(html: str) -> list[str]:
    """Return the addresses in the network from which a page takes scripts, styles, fonts or images."""
    parser = _Taken()
    parser.feed(html)
    return parser.remote


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Warn of what a page would take from the network."""
    for address in taken(output):
        log.warning("%s takes %s from the network", page.file.dest_uri, address)
    return output
